#include "camber/render/scene_actors.h"

#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkFloatArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "camber/render/color_map.h"
#include "camber/render/scene_camera.h"
#include "camber/render/wireframe.h"

namespace camber {
namespace {

using Segment3 = std::pair<Eigen::Vector3d, Eigen::Vector3d>;

vtkSmartPointer<vtkActor> make_actor(vtkPolyData* data) {
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputData(data);
  auto actor = vtkSmartPointer<vtkActor>::New();
  actor->SetMapper(mapper);
  actor->GetProperty()->LightingOff();
  return actor;
}

void paint(vtkActor* actor, const Color& color) {
  actor->GetProperty()->SetColor(color.red / 255.0, color.green / 255.0, color.blue / 255.0);
  actor->GetProperty()->SetOpacity(color.alpha);
}

/// Points of one colour each, or all of one colour where `inks` is empty.
vtkSmartPointer<vtkActor> cloud_actor(const std::vector<Eigen::Vector3f>& places,
                                      const std::vector<std::array<std::uint8_t, 3>>& inks,
                                      const Color& color, double pixels) {
  const auto count = static_cast<vtkIdType>(places.size());
  vtkNew<vtkFloatArray> coordinates;
  coordinates->SetNumberOfComponents(3);
  coordinates->SetNumberOfTuples(count);
  std::memcpy(coordinates->GetPointer(0), places.data(), sizeof(float) * 3 * places.size());
  vtkNew<vtkPoints> points;
  points->SetData(coordinates);
  vtkNew<vtkCellArray> cells;
  cells->AllocateExact(1, count);
  cells->InsertNextCell(static_cast<int>(count));
  for (vtkIdType i = 0; i < count; ++i) cells->InsertCellPoint(i);
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetVerts(cells);
  if (!inks.empty()) {
    vtkNew<vtkUnsignedCharArray> colors;
    colors->SetNumberOfComponents(3);
    colors->SetNumberOfTuples(count);
    std::memcpy(colors->GetPointer(0), inks.data(), 3 * inks.size());
    data->GetPointData()->SetScalars(colors);
  }
  auto actor = make_actor(data);
  if (inks.empty()) paint(actor, color);
  actor->GetProperty()->SetPointSize(static_cast<float>(pixels));
  return actor;
}

vtkSmartPointer<vtkActor> lines_actor(const std::vector<Segment3>& lines, double pixels,
                                      const Color& color) {
  vtkNew<vtkPoints> points;
  points->SetDataTypeToFloat();
  vtkNew<vtkCellArray> cells;
  for (const Segment3& line : lines) {
    const vtkIdType ends[2] = {points->InsertNextPoint(line.first.data()),
                               points->InsertNextPoint(line.second.data())};
    cells->InsertNextCell(2, ends);
  }
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetLines(cells);
  auto actor = make_actor(data);
  actor->GetProperty()->SetLineWidth(static_cast<float>(pixels));
  paint(actor, color);
  return actor;
}

vtkSmartPointer<vtkActor> faces_actor(const std::vector<std::vector<Eigen::Vector3d>>& polygons,
                                      const Color& color) {
  vtkNew<vtkPoints> points;
  points->SetDataTypeToFloat();
  vtkNew<vtkCellArray> cells;
  for (const auto& polygon : polygons) {
    cells->InsertNextCell(static_cast<int>(polygon.size()));
    for (const Eigen::Vector3d& corner : polygon) {
      cells->InsertCellPoint(points->InsertNextPoint(corner.data()));
    }
  }
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetPolys(cells);
  auto actor = make_actor(data);
  paint(actor, color);
  return actor;
}

std::vector<Segment3> outline(const std::vector<Eigen::Vector3d>& corners) {
  std::vector<Segment3> lines;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    lines.emplace_back(corners[i], corners[(i + 1) % corners.size()]);
  }
  return lines;
}

std::vector<Segment3> box_lines(const OrientedBox& box) {
  const auto corners = box.corners();
  std::vector<Segment3> lines;
  for (const auto& [a, b] : box_edges()) lines.emplace_back(corners.col(a), corners.col(b));
  return lines;
}

void append(std::vector<Segment3>* lines, const std::vector<Segment3>& more) {
  lines->insert(lines->end(), more.begin(), more.end());
}

SharedActor shared(const vtkSmartPointer<vtkActor>& actor) {
  actor->Register(nullptr);
  return {actor.Get(), [](vtkActor* owned) { owned->UnRegister(nullptr); }};
}

/// Segments with a colour each.
vtkSmartPointer<vtkActor> colored_lines_actor(const std::vector<Segment3>& lines,
                                              const std::vector<Color>& inks, double pixels) {
  auto actor = lines_actor(lines, pixels, kInk);
  vtkNew<vtkUnsignedCharArray> colors;
  colors->SetNumberOfComponents(3);
  for (const Color& ink : inks) colors->InsertNextTuple3(ink.red, ink.green, ink.blue);
  vtkPolyDataMapper::SafeDownCast(actor->GetMapper())
      ->GetInput()
      ->GetCellData()
      ->SetScalars(colors);
  return actor;
}

/// A shaft with four barbs.
void append_arrow(std::vector<Segment3>* lines, const Eigen::Vector3d& from,
                  const Eigen::Vector3d& direction) {
  const Eigen::Vector3d tip = from + direction;
  lines->emplace_back(from, tip);
  const Eigen::Vector3d side = direction.unitOrthogonal() * (0.12 * direction.norm());
  const Eigen::Vector3d other = direction.normalized().cross(side);
  for (const Eigen::Vector3d& barb :
       {side, Eigen::Vector3d(-side), other, Eigen::Vector3d(-other)}) {
    lines->emplace_back(tip, tip - 0.25 * direction + barb);
  }
}

/// Parts of a segment with gaps between them.
void append_dashes(std::vector<Segment3>* lines, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                   double dash) {
  const int dashes = std::clamp(static_cast<int>((b - a).norm() / (1.6 * dash)), 3, 40);
  for (int i = 0; i < dashes; ++i) {
    const double from = (i + 0.2) / dashes, to = (i + 0.8) / dashes;
    lines->emplace_back(a + from * (b - a), a + to * (b - a));
  }
}

/// Patches and links stand a little above the points, whose noise would hide them.
double lift_of(const PictureSpace& space) {
  return 0.001 * (space.ahead.span() + space.right.span());
}

/// The layers of a scene while they are filled, one a switch.
class Layers {
 public:
  explicit Layers(double line_unit) : line_unit_(line_unit) {
    for (const SceneSwitch& entry : scene_switches()) layers_.push_back({entry.element, {}});
  }
  void add(SceneElement element, const vtkSmartPointer<vtkActor>& actor) {
    layers_[static_cast<std::size_t>(element)].actors.push_back(shared(actor));
  }
  /// @param width  of the lines, in line units; nothing is added where there are none
  void add_lines(SceneElement element, const std::vector<Segment3>& lines, double width,
                 const Color& color) {
    if (!lines.empty()) add(element, lines_actor(lines, width * line_unit_, color));
  }
  double line_unit() const { return line_unit_; }
  /// Those with something in them that are wanted.
  std::vector<SceneLayer> filled(const std::function<bool(SceneElement)>& wanted) && {
    layers_.erase(std::remove_if(layers_.begin(), layers_.end(),
                                 [&](const SceneLayer& layer) {
                                   return layer.actors.empty() || !wanted(layer.element);
                                 }),
                  layers_.end());
    return std::move(layers_);
  }

 private:
  double line_unit_;  // pixels
  std::vector<SceneLayer> layers_;
};

void add_grid(const PictureSpace& space, Layers& layers) {
  const SceneGrid grid = make_scene_grid(space);
  std::vector<Segment3> lines = outline({{grid.x1, grid.y1, grid.z},
                                         {grid.x2, grid.y1, grid.z},
                                         {grid.x2, grid.y2, grid.z},
                                         {grid.x1, grid.y2, grid.z}});
  for (const double x : grid.xs.values) {
    lines.push_back({{x, grid.y1, grid.z}, {x, grid.y2, grid.z}});
  }
  for (const double y : grid.ys.values) {
    lines.push_back({{grid.x1, y, grid.z}, {grid.x2, y, grid.z}});
  }
  layers.add_lines(SceneElement::kGrid, lines, 1.0, {206, 210, 215, 1.0});
}

void add_wireframe(const PlacedVehicle& vehicle, const Color& color, Layers& layers) {
  std::vector<Segment3> lines;
  for (const auto& [a, b] : wireframe_edges()) {
    lines.emplace_back(vehicle.keypoints[a], vehicle.keypoints[b]);
  }
  layers.add_lines(SceneElement::kVehicles, lines, 2.6, darker(color, 0.5));
  std::vector<std::vector<Eigen::Vector3d>> faces;
  for (const auto& t : wireframe_triangles()) {
    faces.push_back({vehicle.keypoints[t[0]], vehicle.keypoints[t[1]], vehicle.keypoints[t[2]]});
  }
  layers.add(SceneElement::kVehicles, faces_actor(faces, color.with_alpha(0.6)));
}

/// Bodies, boxes and the ground under them.
void add_vehicles(const std::vector<PlacedVehicle>& vehicles, Layers& layers) {
  for (const PlacedVehicle& vehicle : vehicles) {
    const Color color = vehicle_color(vehicle);
    if (vehicle.wireframe) add_wireframe(vehicle, color, layers);
    layers.add_lines(SceneElement::kBoxes, box_lines(vehicle.box), 1.0, darker(color, 0.6));
    if (vehicle.ground.empty()) continue;
    layers.add_lines(SceneElement::kPlanes, outline(vehicle.ground), 1.6, darker(color, 0.8));
    layers.add(SceneElement::kPlanes, faces_actor({vehicle.ground}, color.with_alpha(0.25)));
  }
}

void add_truth(const std::vector<PlacedVehicle>& vehicles, Layers& layers) {
  std::vector<Segment3> boxes, planes;
  for (const PlacedVehicle& vehicle : vehicles) {
    append(&boxes, box_lines(vehicle.box));
    if (!vehicle.ground.empty()) append(&planes, outline(vehicle.ground));
  }
  layers.add_lines(SceneElement::kTruth, boxes, 1.5, kTruthRed);
  layers.add_lines(SceneElement::kTruth, planes, 1.0, kTruthRed);
}

/// Small pyramids, where `camera` is known, and the path.
void add_cameras(const PictureSpace& space, const PinholeCamera* camera, Layers& layers) {
  std::vector<Segment3> path, pyramids;
  const double depth =
      std::clamp(0.015 * std::max(space.ahead.span(), space.right.span()), 0.3, 20.0);
  for (std::size_t i = 0; i < space.cameras.size(); ++i) {
    if (i > 0) {
      path.emplace_back(space.cameras[i - 1].translation(), space.cameras[i].translation());
    }
    if (!camera) continue;
    std::vector<Eigen::Vector3d> placed;
    for (const Eigen::Vector3d& corner : frustum_corners(*camera, depth)) {
      placed.push_back(space.cameras[i] * corner);
    }
    append(&pyramids, outline(placed));
    for (const Eigen::Vector3d& corner : placed) {
      pyramids.emplace_back(space.cameras[i].translation(), corner);
    }
  }
  layers.add_lines(SceneElement::kCameras, pyramids, 1.3, kInk);
  layers.add_lines(SceneElement::kCameras, path, 2.5, kInk);
}

void add_patches(const PictureSpace& space, Layers& layers) {
  const double lift = lift_of(space);
  std::vector<std::vector<Eigen::Vector3d>> panes;
  std::vector<Segment3> normals;
  const double normal_length =
      std::clamp(0.04 * std::max(space.ahead.span(), space.right.span()), 0.3, 200.0);
  for (const PlacedPatch& patch : space.patches) {
    panes.push_back(patch.boundary);
    for (Eigen::Vector3d& corner : panes.back()) corner.z() += lift;
    layers.add_lines(SceneElement::kPatches, outline(panes.back()), 2.0, patch_color(patch.kind));
    append_arrow(&normals, patch.middle, patch.normal * normal_length);
  }
  if (!panes.empty()) {
    layers.add(SceneElement::kPatches, faces_actor(panes, kPaper.with_alpha(0.4)));
  }
  layers.add_lines(SceneElement::kNormals, normals, 2.0, patch_color(PatchKind::kRoad));
}

/// The consistency graph: valid links coloured, others dashed.
void add_links(const PictureSpace& space, Layers& layers) {
  const double lift = lift_of(space);
  std::vector<Segment3> valid, invalid;
  std::vector<Color> inks;
  for (const PlacedLink& link : space.links) {
    Eigen::Vector3d a = link.a, b = link.b;
    a.z() += 2.0 * lift;
    b.z() += 2.0 * lift;
    if (link.valid) {
      valid.emplace_back(a, b);
      inks.push_back(link_color(link, space));
    } else {
      append_dashes(&invalid, a, b, 5.0 * lift);
    }
  }
  if (!valid.empty()) {
    layers.add(SceneElement::kLinks, colored_lines_actor(valid, inks, 3.5 * layers.line_unit()));
  }
  layers.add_lines(SceneElement::kLinks, invalid, 1.6, kInk);
}

}  // namespace

std::vector<SceneLayer> make_scene_layers(const PictureContent& content, const PictureSpace& space,
                                          const SceneStyle& style,
                                          const std::function<bool(SceneElement)>& wanted) {
  const auto want = [&](SceneElement element) { return !wanted || wanted(element); };
  Layers layers(style.line_unit);
  add_grid(space, layers);
  if (!space.truth_points.empty() && want(SceneElement::kTruthCloud)) {
    layers.add(SceneElement::kTruthCloud, cloud_actor(space.truth_points, {}, kTruthGrey,
                                                      std::max(1.0, 0.75 * style.point_size)));
  }
  if (!space.points.empty() && want(SceneElement::kPoints)) {
    layers.add(SceneElement::kPoints,
               cloud_actor(space.points, space.colors, kInk, style.point_size));
  }
  add_vehicles(space.vehicles, layers);
  add_truth(space.truth, layers);
  add_cameras(space, content.camera, layers);
  add_patches(space, layers);
  add_links(space, layers);
  return std::move(layers).filled(want);
}

void apply_camera(const SceneCamera& from, const PictureSpace& space, vtkCamera* to) {
  const Eigen::Vector3d along = from.axes.row(2), up = from.axes.row(1);
  const Eigen::Vector3d focus = from.eye + from.distance * along;
  to->SetPosition(from.eye.data());
  to->SetFocalPoint(focus.data());
  to->SetViewUp(up.data());
  if (from.parallel) {
    to->ParallelProjectionOn();
    to->SetParallelScale(from.half_height);
  } else {
    to->SetViewAngle(2.0 * from.half_angle * 180.0 / M_PI);
  }
  // Stray points must not stretch the depth range until near things flicker through each other.
  const double reach = 2.0 * (space.right.span() + space.ahead.span() + space.up.span()) + 20.0;
  to->SetClippingRange(std::max(0.05, from.distance - reach), from.distance + reach);
}

}  // namespace camber
