#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkCameraPass.h>
#include <vtkDefaultPass.h>
#include <vtkLightsPass.h>
#include <vtkNew.h>
#include <vtkRenderPassCollection.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkSequencePass.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/memory.h"
#include "camber/render/detail/silenced_vtk.h"
#include "camber/render/detail/vtk_drawing.h"
#include "camber/render/gl_context.h"
#include "camber/render/picture_file.h"
#include "camber/render/scene_actors.h"

namespace camber {
namespace {

/// Draws solid things, then blends translucent ones over them in their order. VTK's own pass, which
/// needs no order, takes a quarter of a picture's time.
vtkSmartPointer<vtkCameraPass> blending_pass() {
  vtkNew<vtkRenderPassCollection> steps;
  steps->AddItem(vtkNew<vtkLightsPass>());
  steps->AddItem(vtkNew<vtkDefaultPass>());
  vtkNew<vtkSequencePass> sequence;
  sequence->SetPasses(steps);
  auto out = vtkSmartPointer<vtkCameraPass>::New();
  out->SetDelegatePass(sequence);
  return out;
}

/// From the eye to the middle of what an actor draws.
double distance_of(vtkActor& actor, const Eigen::Vector3d& eye) {
  const double* middle = actor.GetCenter();
  return (Eigen::Vector3d(middle[0], middle[1], middle[2]) - eye).norm();
}

}  // namespace

Image render_scene_content(const SceneShot& shot, KeptWindow* kept, RenderRecord* record) {
  const PictureSpace& space = shot.space;
  const SceneCamera& view = shot.camera;
  const double unit = shot.line_unit;
  const int factor = shot.options.supersampling;
  constexpr std::size_t kPointBytes = 200;  // of VTK's and OpenGL's copies of a point, measured 170
  const std::size_t points = space.points.size() + space.truth_points.size();
  require_address_space(kPointBytes * points,
                        "drawing a cloud of " + std::to_string(points) + " points");
  const int width = view.width * factor, height = view.height * factor;
  if (!*kept) *kept = std::make_shared<OffscreenWindow>(width, height);
  OffscreenWindow& offscreen = *static_cast<OffscreenWindow*>(kept->get());
  offscreen.resize(width, height);
  vtkNew<vtkRenderer> renderer;
  renderer->SetPass(blending_pass());
  renderer->SetBackground(shot.background.red / 255.0, shot.background.green / 255.0,
                          shot.background.blue / 255.0);
  SceneStyle style;
  style.line_unit = unit * factor;
  double size = shot.options.point_size;
  const std::size_t count = std::max(space.points.size(), space.truth_points.size());
  if (size <= 0.0 && count > 0) {
    // Enough to close the gaps of the bulk, never blobs.
    const double area = std::max(1e-6, space.right.span() * space.ahead.span());
    const double spacing = std::sqrt(area / static_cast<double>(count));
    const Eigen::Vector3d middle(0.5 * (space.right.low + space.right.high),
                                 0.5 * (space.ahead.low + space.ahead.high), shot.grid.z);
    size = std::clamp(0.35 * spacing * view.pixels_per_metre(middle) / unit, 1.3, 3.2) * unit;
  }
  style.point_size = std::max(1.0, size * factor);
  // The side view has lines of equal height of its own; from within, frame and cameras only hide.
  const bool through_camera = shot.options.view == SceneView::kDriver;
  std::vector<SharedActor> ground, things;
  for (const SceneLayer& layer : make_scene_layers(shot.content, space, style)) {
    const bool frame = layer.element == SceneElement::kGrid;
    const bool camera = layer.element == SceneElement::kCameras;
    if (!shot.options.shows(layer.element) || (frame && (view.parallel || through_camera)) ||
        (camera && through_camera)) {
      continue;
    }
    const bool flat =
        layer.element == SceneElement::kPatches || layer.element == SceneElement::kPlanes;
    std::vector<SharedActor>& to = flat ? ground : things;
    to.insert(to.end(), layer.actors.begin(), layer.actors.end());
  }
  // Blended in this order: what stands on the ground after it, the nearest last.
  for (std::vector<SharedActor>* actors : {&ground, &things}) {
    std::stable_sort(actors->begin(), actors->end(),
                     [&](const SharedActor& a, const SharedActor& b) {
                       return distance_of(*a, view.eye) > distance_of(*b, view.eye);
                     });
    for (const SharedActor& actor : *actors) renderer->AddActor(actor.get());
  }

  apply_camera(view, space, renderer->GetActiveCamera());
  vtkRenderWindow* window = offscreen.window();
  window->AddRenderer(renderer);
  window->Render();
  vtkNew<vtkUnsignedCharArray> pixels;
  {
    const SilencedVtk silenced;  // without memory VTK prints before it throws
    window->GetPixelData(0, 0, width - 1, height - 1, 0, pixels);
  }
  if (pixels->GetNumberOfValues() != static_cast<vtkIdType>(3) * width * height) {
    throw MachineError("the rendering back end " + offscreen.backend() + " returned no picture");
  }
  if (record) {
    record->backend = offscreen.backend();
    record->renderer = offscreen.renderer();
  }
  const cv::Mat upside_down(height, width, CV_8UC3, pixels->GetPointer(0));
  cv::Mat upright;
  cv::flip(upside_down, upright, 0);
  Image image = make_picture(view.width, view.height, 255);
  cv::Mat out(view.height, view.width, CV_8UC3, image.data.data());
  cv::resize(upright, out, out.size(), 0, 0, cv::INTER_AREA);
  window->RemoveRenderer(renderer);
  return image;
}

}  // namespace camber
