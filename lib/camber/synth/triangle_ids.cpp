#include "camber/synth/triangle_ids.h"

#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkFloatArray.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkUnsignedCharArray.h>

#include <Eigen/Geometry>

#include "camber/core/errors.h"
#include "camber/render/gl_context.h"

namespace camber {
namespace {

constexpr double kNear = 0.2, kFar = 3000.0;  // m

/// Triangles in eye coordinates with their number (from 1) as colour.
class IdMesh {
 public:
  IdMesh(const PinholeCamera& camera) : camera_(camera) {
    points_->SetDataTypeToFloat();
    colors_->SetNumberOfComponents(3);
  }

  void add(const SynthMesh& mesh, const SE3& camera_from_mesh, int car) {
    const Eigen::Matrix3d r = camera_from_mesh.rotation_matrix();
    const Eigen::Vector3d t = camera_from_mesh.translation();
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      Eigen::Vector3d p[3];
      for (int k = 0; k < 3; ++k) p[k] = r * mesh.triangles[i].points[k] + t;
      if (outside(p)) continue;
      vtkIdType ids[3];
      for (int k = 0; k < 3; ++k) ids[k] = points_->InsertNextPoint(p[k].x(), -p[k].y(), -p[k].z());
      cells_->InsertNextCell(3, ids);
      owners_.push_back({0.0, car, static_cast<int>(i)});
      const auto id = static_cast<std::uint32_t>(owners_.size());
      colors_->InsertNextTuple3(id & 255u, (id >> 8) & 255u, (id >> 16) & 255u);
    }
  }

  vtkSmartPointer<vtkPolyData> data() const {
    vtkNew<vtkPolyData> out;
    out->SetPoints(points_);
    out->SetPolys(cells_);
    out->GetCellData()->SetScalars(colors_);
    return out;
  }
  const std::vector<WorldHit>& owners() const { return owners_; }

 private:
  /// Whether a triangle lies beyond one side of the viewing frustum.
  bool outside(const Eigen::Vector3d* p) const {
    const auto all = [&](auto&& beyond) { return beyond(p[0]) && beyond(p[1]) && beyond(p[2]); };
    const double left = (-0.5 - camera_.cx) / camera_.fx;
    const double right = (camera_.width - 0.5 - camera_.cx) / camera_.fx;
    const double top = (-0.5 - camera_.cy) / camera_.fy;
    const double bottom = (camera_.height - 0.5 - camera_.cy) / camera_.fy;
    return all([](const Eigen::Vector3d& q) { return q.z() < kNear; }) ||
           all([&](const Eigen::Vector3d& q) { return q.x() < left * q.z(); }) ||
           all([&](const Eigen::Vector3d& q) { return q.x() > right * q.z(); }) ||
           all([&](const Eigen::Vector3d& q) { return q.y() < top * q.z(); }) ||
           all([&](const Eigen::Vector3d& q) { return q.y() > bottom * q.z(); });
  }

  const PinholeCamera& camera_;
  vtkNew<vtkPoints> points_;
  vtkNew<vtkCellArray> cells_;
  vtkNew<vtkUnsignedCharArray> colors_;
  std::vector<WorldHit> owners_;
};

}  // namespace

TriangleIds rasterise_triangle_ids(const SynthWorld& world, int frame, const PinholeCamera& camera,
                                   int supersampling) {
  TriangleIds out;
  out.width = camera.width * supersampling;
  out.height = camera.height * supersampling;

  IdMesh mesh(camera);
  const SE3 camera_from_world = world.views[frame].world_from_camera.inverse();
  mesh.add(world.ground_and_things, camera_from_world, -1);
  for (std::size_t i = 0; i < world.cars.size(); ++i) {
    mesh.add(world.cars[i].mesh, camera_from_world * world.cars[i].world_from_vehicle[frame],
             static_cast<int>(i));
  }

  OffscreenWindow offscreen(out.width, out.height);
  vtkRenderWindow* window = offscreen.window();
  window->SetMultiSamples(0);
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputData(mesh.data());
  mapper->SetScalarModeToUseCellData();
  mapper->SetColorModeToDirectScalars();
  mapper->StaticOn();
  vtkNew<vtkActor> actor;
  actor->SetMapper(mapper);
  actor->GetProperty()->LightingOff();
  actor->GetProperty()->SetInterpolationToFlat();
  vtkNew<vtkRenderer> renderer;
  renderer->SetBackground(0, 0, 0);
  renderer->AddActor(actor);

  // Points are in eye coordinates already; pixel centres at integers, so the image spans
  // [-0.5, size - 0.5].
  vtkCamera* eye = renderer->GetActiveCamera();
  eye->SetPosition(0, 0, 0);
  eye->SetFocalPoint(0, 0, -1);
  eye->SetViewUp(0, 1, 0);
  eye->SetClippingRange(kNear, kFar);
  vtkNew<vtkMatrix4x4> projection;
  projection->Zero();
  projection->SetElement(0, 0, 2.0 * camera.fx / camera.width);
  projection->SetElement(0, 2, 1.0 - 2.0 * (camera.cx + 0.5) / camera.width);
  projection->SetElement(1, 1, 2.0 * camera.fy / camera.height);
  projection->SetElement(1, 2, 2.0 * (camera.cy + 0.5) / camera.height - 1.0);
  projection->SetElement(2, 2, -(kFar + kNear) / (kFar - kNear));
  projection->SetElement(2, 3, -2.0 * kFar * kNear / (kFar - kNear));
  projection->SetElement(3, 2, -1.0);
  eye->SetExplicitProjectionTransformMatrix(projection);
  eye->UseExplicitProjectionTransformMatrixOn();
  window->AddRenderer(renderer);
  window->Render();

  vtkNew<vtkUnsignedCharArray> pixels;
  window->GetPixelData(0, 0, out.width - 1, out.height - 1, 0, pixels);
  window->RemoveRenderer(renderer);
  if (pixels->GetNumberOfTuples() != static_cast<vtkIdType>(out.width) * out.height) {
    throw MachineError("the off-screen picture could not be read back");
  }
  out.hits.resize(static_cast<std::size_t>(out.width) * out.height);
  const unsigned char* bytes = pixels->GetPointer(0);
  for (int y = 0; y < out.height; ++y) {
    const unsigned char* row = bytes + static_cast<std::size_t>(out.height - 1 - y) * out.width * 3;
    for (int x = 0; x < out.width; ++x) {
      const std::uint32_t id = row[3 * x] | row[3 * x + 1] << 8 | row[3 * x + 2] << 16;
      if (id > mesh.owners().size()) {
        throw MachineError("the off-screen picture has colours that were not drawn");
      }
      out.hits[static_cast<std::size_t>(y) * out.width + x] =
          id ? mesh.owners()[id - 1] : WorldHit{};
    }
  }
  return out;
}

}  // namespace camber
