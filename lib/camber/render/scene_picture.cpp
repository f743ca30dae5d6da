#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/render/canvas.h"
#include "camber/render/color_map.h"
#include "camber/render/gl_context.h"
#include "camber/render/label_layout.h"
#include "camber/render/picture_file.h"
#include "camber/render/picture_space.h"
#include "camber/render/pictures.h"
#include "camber/render/wireframe.h"

namespace camber {
namespace {

const Color kLinkOrange{240, 120, 0, 1.0};

using Segment3 = std::pair<Eigen::Vector3d, Eigen::Vector3d>;

/// A camera that looks at the picture frame's content; perspective or parallel.
struct View {
  Eigen::Matrix3d axes;  // rows: right, up (of the image), along the view; picture frame
  bool parallel = false;
  double half_angle = 0.2;   // rad, vertical, perspective
  double half_height = 1.0;  // m, parallel
  Eigen::Vector3d eye = Eigen::Vector3d::Zero();
  double distance = 1.0;      // m from the eye to the content's middle
  int width = 0, height = 0;  // pixels

  /// Pixel of a point; false behind the eye.
  bool project(const Eigen::Vector3d& x, Eigen::Vector2d* pixel) const {
    const Eigen::Vector3d c = axes * (x - eye);
    double scale = 0.5 * height / half_height;
    if (!parallel) {
      if (c.z() <= 1e-6) return false;
      scale = 0.5 * height / (std::tan(half_angle) * c.z());
    }
    *pixel = {0.5 * width - 0.5 + scale * c.x(), 0.5 * height - 0.5 - scale * c.y()};
    return true;
  }

  /// Pixels a metre takes at a point.
  double pixels_per_metre(const Eigen::Vector3d& x) const {
    if (parallel) return 0.5 * height / half_height;
    const double z = (axes * (x - eye)).z();
    return 0.5 * height / (std::tan(half_angle) * std::max(z, 1e-6));
  }
};

/// Moves the eye so that all points fall into `free` (pixels of a width x height picture), as
/// large as possible. With a fixed direction each side of the frustum bounds the eye linearly.
void fit_view(const std::vector<Eigen::Vector3d>& points, const Box2& free, View* view) {
  const double w = view->width, h = view->height;
  // Tangents of the free area's sides, or half heights per unit in a parallel view.
  const double t = view->parallel ? 1.0 : std::tan(view->half_angle);
  const double left = (0.5 * w - free.x1) * 2.0 * t / h, right = (free.x2 - 0.5 * w) * 2.0 * t / h;
  const double top = (0.5 * h - free.y1) * 2.0 * t / h, bottom = (free.y2 - 0.5 * h) * 2.0 * t / h;
  constexpr double kInf = std::numeric_limits<double>::infinity();
  double min_x = kInf, max_x = -kInf, min_y = kInf, max_y = -kInf, min_z = kInf, max_z = -kInf;
  for (const Eigen::Vector3d& x : points) {
    const Eigen::Vector3d c = view->axes * x;
    const double z = view->parallel ? 0.0 : c.z();
    // A point is inside if -left (z + D) <= x - ex <= right (z + D), likewise y.
    min_x = std::min(min_x, c.x() + left * z);
    max_x = std::max(max_x, c.x() - right * z);
    min_y = std::min(min_y, c.y() + bottom * z);
    max_y = std::max(max_y, c.y() - top * z);
    min_z = std::min(min_z, c.z());
    max_z = std::max(max_z, c.z());
  }
  // D: how far the eye stands before z = 0 (perspective), or the half height (parallel).
  const double from_x = (max_x - min_x) / std::max(left + right, 1e-9);
  const double from_y = (max_y - min_y) / std::max(top + bottom, 1e-9);
  double d = std::max({from_x, from_y, 1e-3});
  if (!view->parallel) d = std::max(d, 0.5 - min_z);
  const double ex = 0.5 * ((min_x + left * d) + (max_x - right * d));
  const double ey = 0.5 * ((min_y + bottom * d) + (max_y - top * d));
  double ez = -d;
  if (view->parallel) {
    view->half_height = d;
    ez = min_z - 0.5 * (max_z - min_z) - 10.0;
  }
  view->eye = view->axes.transpose() * Eigen::Vector3d(ex, ey, ez);
  view->distance = 0.5 * (min_z + max_z) - ez;
}

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

vtkSmartPointer<vtkActor> points_actor(const PictureSpace& space, double pixels) {
  const auto count = static_cast<vtkIdType>(space.points.size());
  vtkNew<vtkFloatArray> coordinates;
  coordinates->SetNumberOfComponents(3);
  coordinates->SetNumberOfTuples(count);
  vtkNew<vtkUnsignedCharArray> colors;
  colors->SetNumberOfComponents(3);
  colors->SetNumberOfTuples(count);
  float* to = coordinates->GetPointer(0);
  unsigned char* ink = colors->GetPointer(0);
  for (std::size_t i = 0; i < space.points.size(); ++i) {
    for (int k = 0; k < 3; ++k) *to++ = space.points[i][k];
    for (int k = 0; k < 3; ++k) *ink++ = space.colors[i][static_cast<std::size_t>(k)];
  }
  vtkNew<vtkPoints> points;
  points->SetData(coordinates);
  vtkNew<vtkCellArray> cells;
  cells->AllocateExact(1, count);
  cells->InsertNextCell(static_cast<int>(count));
  for (vtkIdType i = 0; i < count; ++i) cells->InsertCellPoint(i);
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetVerts(cells);
  data->GetPointData()->SetScalars(colors);
  auto actor = make_actor(data);
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

/// A level grid below the content with a round spacing.
struct Grid {
  double z = 0.0;
  double x1 = 0, x2 = 0, y1 = 0, y2 = 0;
  Ticks xs, ys;
};

Grid make_grid(const PictureSpace& space) {
  Grid grid;
  const double span = std::max(space.right.span(), space.ahead.span());
  grid.x1 = space.right.low;
  grid.x2 = space.right.high;
  grid.y1 = space.ahead.low;
  grid.y2 = space.ahead.high;
  const double step = make_ticks(0.0, span, 10).step;
  grid.xs = multiples_of(step, grid.x1, grid.x2);
  grid.ys = multiples_of(step, grid.y1, grid.y2);
  // Just under the bulk of the points, so that the road rises from it.
  grid.z = std::min(space.up.low, space.heights.low) - 0.02 * std::max(space.up.span(), 1.0);
  return grid;
}

struct Drawing {
  const PictureContent& content;
  const PictureSpace& space;
  const ScenePictureOptions& options;
  RenderRecord* record;
};

std::vector<Eigen::Vector3d> fit_points(const PictureSpace& space, const Grid& grid, bool side) {
  std::vector<Eigen::Vector3d> points;
  const auto inside = [&](const Eigen::Vector3d& x) {
    return x.x() >= space.right.low && x.x() <= space.right.high && x.y() >= space.ahead.low &&
           x.y() <= space.ahead.high && x.z() >= space.up.low && x.z() <= space.up.high;
  };
  const std::size_t stride = std::max<std::size_t>(1, space.points.size() / 20000);
  for (std::size_t i = 0; i < space.points.size(); i += stride) {
    const Eigen::Vector3d x = space.points[i].cast<double>();
    if (inside(x)) points.push_back(x);
  }
  for (const auto* list : {&space.vehicles, &space.truth}) {
    for (const PlacedVehicle& vehicle : *list) {
      if (!inside(vehicle.box.center())) continue;
      const auto corners = vehicle.box.corners();
      for (int i = 0; i < 8; ++i) points.emplace_back(corners.col(i));
    }
  }
  for (const SE3& camera : space.cameras) {
    if (inside(camera.translation())) points.push_back(camera.translation());
  }
  if (!side) {
    for (const double x : {grid.x1, grid.x2}) {
      for (const double y : {grid.y1, grid.y2}) points.emplace_back(x, y, grid.z);
    }
  } else {
    points.emplace_back(0.5 * (space.right.low + space.right.high), space.ahead.low, grid.z);
    points.emplace_back(0.5 * (space.right.low + space.right.high), space.ahead.high, grid.z);
  }
  return points;
}

/// Pixels of the 3D content without any text.
Image render_content(const Drawing& drawing, const View& view, const Grid& grid, double unit) {
  const PictureSpace& space = drawing.space;
  const int factor = drawing.options.supersampling;
  const double px = unit * factor;  // one line width unit in rendered pixels
  OffscreenWindow offscreen(view.width * factor, view.height * factor);
  vtkNew<vtkRenderer> renderer;
  renderer->SetBackground(1, 1, 1);

  // The level grid; the side view has lines of equal height of its own.
  std::vector<Segment3> grid_lines;
  const bool through_camera = drawing.options.view == SceneView::kDriver;
  if (!view.parallel && !through_camera) {
    for (const double x : grid.xs.values) {
      grid_lines.push_back({{x, grid.y1, grid.z}, {x, grid.y2, grid.z}});
    }
    for (const double y : grid.ys.values) {
      grid_lines.push_back({{grid.x1, y, grid.z}, {grid.x2, y, grid.z}});
    }
    append(&grid_lines, outline({{grid.x1, grid.y1, grid.z},
                                 {grid.x2, grid.y1, grid.z},
                                 {grid.x2, grid.y2, grid.z},
                                 {grid.x1, grid.y2, grid.z}}));
    renderer->AddActor(lines_actor(grid_lines, 1.0 * px, {206, 210, 215, 1.0}));
  }

  // Opaque things.
  if (!space.points.empty()) {
    double size = drawing.options.point_size;
    if (size <= 0.0) {
      // Enough to close the gaps of the bulk, never blobs.
      const double area = std::max(1.0, space.right.span() * space.ahead.span());
      const double spacing = std::sqrt(area / static_cast<double>(space.points.size()));
      const Eigen::Vector3d middle(0.5 * (space.right.low + space.right.high),
                                   0.5 * (space.ahead.low + space.ahead.high), grid.z);
      size = std::clamp(0.35 * spacing * view.pixels_per_metre(middle) / unit, 1.3, 3.2) * unit;
    }
    renderer->AddActor(points_actor(space, std::max(1.0, size * factor)));
  }
  for (const PlacedVehicle& vehicle : space.vehicles) {
    const Color color = vehicle_color(vehicle);
    if (vehicle.wireframe) {
      std::vector<Segment3> lines;
      for (const auto& [a, b] : wireframe_edges()) {
        lines.emplace_back(vehicle.keypoints[a], vehicle.keypoints[b]);
      }
      renderer->AddActor(lines_actor(lines, 2.6 * px, darker(color, 0.5)));
    }
    renderer->AddActor(lines_actor(box_lines(vehicle.box), 1.0 * px, darker(color, 0.6)));
  }
  std::vector<Segment3> truth_lines;
  for (const PlacedVehicle& vehicle : space.truth) append(&truth_lines, box_lines(vehicle.box));
  if (!truth_lines.empty()) renderer->AddActor(lines_actor(truth_lines, 1.5 * px, kTruthRed));

  // Cameras: small pyramids and the path.
  if (!space.cameras.empty() && !through_camera) {
    std::vector<Segment3> path, pyramids;
    const double depth =
        std::clamp(0.015 * std::max(space.ahead.span(), space.right.span()), 0.3, 20.0);
    for (std::size_t i = 0; i < space.cameras.size(); ++i) {
      if (i > 0) {
        path.emplace_back(space.cameras[i - 1].translation(), space.cameras[i].translation());
      }
      if (!drawing.content.camera) continue;
      const auto corners = frustum_corners(*drawing.content.camera, depth);
      std::vector<Eigen::Vector3d> placed;
      for (const Eigen::Vector3d& corner : corners) placed.push_back(space.cameras[i] * corner);
      append(&pyramids, outline(placed));
      for (const Eigen::Vector3d& corner : placed) {
        pyramids.emplace_back(space.cameras[i].translation(), corner);
      }
    }
    if (!pyramids.empty()) renderer->AddActor(lines_actor(pyramids, 1.3 * px, kInk));
    if (!path.empty()) renderer->AddActor(lines_actor(path, 2.5 * px, kInk));
  }
  // Patches stand a little above the points, whose noise would hide them.
  const double lift = 0.001 * (space.ahead.span() + space.right.span());
  std::vector<std::vector<Eigen::Vector3d>> panes;
  for (const PlacedPatch& patch : space.patches) {
    panes.push_back(patch.boundary);
    for (Eigen::Vector3d& corner : panes.back()) corner.z() += lift;
    renderer->AddActor(lines_actor(outline(panes.back()), 2.0 * px, patch_color(patch.kind)));
  }

  if (drawing.options.show_links) {
    std::vector<Segment3> valid, invalid;
    for (const PlacedLink& link : space.links) {
      Eigen::Vector3d a = link.a, b = link.b;
      a.z() += 2.0 * lift;
      b.z() += 2.0 * lift;
      if (link.valid) {
        valid.emplace_back(a, b);
        continue;
      }
      const double length = (b - a).norm();
      const int dashes = std::max(3, static_cast<int>(length / (8.0 * lift)));
      for (int i = 0; i < dashes; ++i) {
        const double from = (i + 0.2) / dashes, to = (i + 0.8) / dashes;
        invalid.emplace_back(a + from * (b - a), a + to * (b - a));
      }
    }
    if (!valid.empty()) renderer->AddActor(lines_actor(valid, 3.0 * px, kLinkOrange));
    if (!invalid.empty()) renderer->AddActor(lines_actor(invalid, 2.0 * px, kLinkOrange));
  }

  // Translucent things, after the opaque ones.
  if (!panes.empty()) renderer->AddActor(faces_actor(panes, kPaper.with_alpha(0.4)));
  for (const PlacedVehicle& vehicle : space.vehicles) {
    if (!vehicle.wireframe) continue;
    std::vector<std::vector<Eigen::Vector3d>> faces;
    for (const auto& t : wireframe_triangles()) {
      faces.push_back({vehicle.keypoints[t[0]], vehicle.keypoints[t[1]], vehicle.keypoints[t[2]]});
    }
    renderer->AddActor(faces_actor(faces, vehicle_color(vehicle).with_alpha(0.6)));
  }

  vtkCamera* camera = renderer->GetActiveCamera();
  const Eigen::Vector3d along = view.axes.row(2), up = view.axes.row(1);
  const Eigen::Vector3d focus = view.eye + view.distance * along;
  camera->SetPosition(view.eye.data());
  camera->SetFocalPoint(focus.data());
  camera->SetViewUp(up.data());
  if (view.parallel) {
    camera->ParallelProjectionOn();
    camera->SetParallelScale(view.half_height);
  } else {
    camera->SetViewAngle(2.0 * view.half_angle * 180.0 / M_PI);
  }
  // Stray points must not stretch the depth range until near things flicker through each other.
  const double reach = 2.0 * (space.right.span() + space.ahead.span() + space.up.span()) + 20.0;
  camera->SetClippingRange(std::max(0.05, view.distance - reach), view.distance + reach);
  vtkRenderWindow* window = offscreen.window();
  window->AddRenderer(renderer);
  window->Render();
  vtkNew<vtkUnsignedCharArray> pixels;
  const int width = view.width * factor, height = view.height * factor;
  window->GetPixelData(0, 0, width - 1, height - 1, 0, pixels);
  if (pixels->GetNumberOfValues() != static_cast<vtkIdType>(3) * width * height) {
    throw MachineError("the rendering back end " + offscreen.backend() + " returned no picture");
  }
  if (drawing.record) *drawing.record = {offscreen.backend(), offscreen.renderer()};
  const cv::Mat upside_down(height, width, CV_8UC3, pixels->GetPointer(0));
  cv::Mat upright, small;
  cv::flip(upside_down, upright, 0);
  Image image = make_picture(view.width, view.height, 255);
  cv::Mat out(view.height, view.width, CV_8UC3, image.data.data());
  cv::resize(upright, out, out.size(), 0, 0, cv::INTER_AREA);
  window->RemoveRenderer(renderer);
  return image;
}

/// Ids and distances beside the vehicles.
void draw_vehicle_labels(Canvas& canvas, const PictureSpace& space, const View& view,
                         const std::vector<Box2>& taken, double text_size, bool with_range) {
  std::vector<LabelRequest> requests;
  std::vector<std::string> texts;
  std::vector<Color> colors;
  LabelLayoutOptions layout;
  layout.area = {4.0, 4.0, canvas.width() - 5.0, canvas.height() - 5.0};
  layout.gap = 0.2 * text_size;
  layout.taken = taken;
  for (const PlacedVehicle& vehicle : space.vehicles) {
    Box2 reach{1e30, 1e30, -1e30, -1e30};
    const auto corners = vehicle.box.corners();
    bool visible = true;
    for (int i = 0; i < 8 && visible; ++i) {
      Eigen::Vector2d p = Eigen::Vector2d::Zero();
      visible = view.project(corners.col(i), &p);
      reach = {std::min(reach.x1, p.x()), std::min(reach.y1, p.y()), std::max(reach.x2, p.x()),
               std::max(reach.y2, p.y())};
    }
    if (!visible) continue;
    const Eigen::Vector2d center = reach.center();
    if (center.x() < 0 || center.y() < 0 || center.x() >= canvas.width() ||
        center.y() >= canvas.height()) {
      continue;
    }
    std::string text = vehicle.name;
    if (with_range) text += "  " + format_number(vehicle.range, 1) + " " + space.unit;
    const Eigen::Vector2d size = Canvas::text_size(text, text_size, true);
    requests.push_back({size + Eigen::Vector2d(0.8 * text_size, 0.1 * text_size), reach});
    layout.avoid.push_back(reach);
    texts.push_back(text);
    colors.push_back(vehicle_color(vehicle));
  }
  const std::vector<LabelPlace> places = place_labels(requests, layout);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!places[i].found || !places[i].leader) continue;
    const Eigen::Vector2d from = places[i].box.center();
    const Box2& t = requests[i].target;
    canvas.segments({{from, {std::clamp(from.x(), t.x1, t.x2), std::clamp(from.y(), t.y1, t.y2)}}},
                    std::max(1.0, text_size / 16.0), kFaintInk);
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!places[i].found) continue;
    const Box2& box = places[i].box;
    canvas.rectangle(box, kPaper.with_alpha(0.85), 0.2 * text_size);
    canvas.rectangle({box.x1, box.y1, box.x1 + 0.25 * text_size, box.y2}, colors[i]);
    canvas.text({box.x1 + 0.5 * text_size, box.center().y()}, texts[i], text_size, kInk,
                TextAnchor::kLeft, true);
  }
}

/// Numbers along two sides of the level grid; returns what they cover.
std::vector<Box2> draw_grid_numbers(Canvas& canvas, const PictureSpace& space, const View& view,
                                    const Grid& grid, double text_size) {
  std::vector<Box2> taken;
  const auto write = [&](const Eigen::Vector3d& at, const Eigen::Vector3d& outwards,
                         const std::string& text) {
    Eigen::Vector2d p, q;
    if (!view.project(at, &p) || !view.project(at + outwards, &q)) return;
    const Eigen::Vector2d way = (q - p).normalized();
    const Eigen::Vector2d size = Canvas::text_size(text, text_size);
    const Eigen::Vector2d middle =
        p + Eigen::Vector2d(way.x() * (0.5 * size.x() + 0.5 * text_size),
                            way.y() * (0.5 * size.y() + 0.4 * text_size));
    const Box2 box{middle.x() - 0.5 * size.x(), middle.y() - 0.5 * size.y(),
                   middle.x() + 0.5 * size.x(), middle.y() + 0.5 * size.y()};
    if (box.x1 < 2 || box.y1 < 2 || box.x2 > canvas.width() - 2 || box.y2 > canvas.height() - 2) {
      return;
    }
    for (const Box2& other : taken) {
      const Box2 grown = other.grown(0.3 * text_size);
      if (box.x1 < grown.x2 && box.x2 > grown.x1 && box.y1 < grown.y2 && box.y2 > grown.y1) return;
    }
    canvas.text(middle, text, text_size, kFaintInk, TextAnchor::kCenter);
    taken.push_back(box);
  };
  // The side nearer to the eye.
  const Eigen::Vector3d eye_way = -view.axes.row(2).transpose();
  const bool low_x = eye_way.x() < 0.0, low_y = eye_way.y() < 0.0;
  const double x = low_x ? grid.x1 : grid.x2, y = low_y ? grid.y1 : grid.y2;
  const Eigen::Vector3d out_x(low_x ? -1.0 : 1.0, 0.0, 0.0), out_y(0.0, low_y ? -1.0 : 1.0, 0.0);
  for (std::size_t i = 0; i < grid.ys.values.size(); ++i) {
    write({x, grid.ys.values[i], grid.z}, out_x, grid.ys.labels[i]);
  }
  for (std::size_t i = 0; i < grid.xs.values.size(); ++i) {
    write({grid.xs.values[i], y, grid.z}, out_y, grid.xs.labels[i]);
  }
  const double far_x = 2.6 * text_size,
               per_m_x = view.pixels_per_metre({x, 0.5 * (grid.y1 + grid.y2), grid.z});
  write(Eigen::Vector3d(x, 0.5 * (grid.y1 + grid.y2), grid.z) + out_x * (far_x / per_m_x), out_x,
        (space.map ? space.ahead_name : "ahead") + " (" + space.unit + ")");
  const double per_m_y = view.pixels_per_metre({0.5 * (grid.x1 + grid.x2), y, grid.z});
  write(Eigen::Vector3d(0.5 * (grid.x1 + grid.x2), y, grid.z) + out_y * (far_x / per_m_y), out_y,
        (space.map ? space.right_name : "right") + " (" + space.unit + ")");
  return taken;
}

View oblique_view(const ScenePictureOptions& options, int width, int height) {
  View view;
  view.width = width;
  view.height = height;
  view.half_angle = 0.5 * 24.0 * M_PI / 180.0;
  const double ca = std::cos(options.azimuth), sa = std::sin(options.azimuth);
  const double ce = std::cos(options.elevation), se = std::sin(options.elevation);
  const Eigen::Vector3d along(ce * sa, ce * ca, -se);
  const Eigen::Vector3d right = along.cross(Eigen::Vector3d::UnitZ()).normalized();
  view.axes.row(0) = right;
  view.axes.row(1) = right.cross(along);
  view.axes.row(2) = along;
  return view;
}

/// Through the shown frame's camera; the picture's narrower side sees all of the image.
View driver_view(const Drawing& drawing, int width, int height) {
  const PictureSpace& space = drawing.space;
  if (space.current_camera < 0 || !drawing.content.camera) {
    throw NoAnswerError("the driver's view needs the camera of frame " +
                        std::to_string(drawing.content.frame) + ", which is not known");
  }
  const PinholeCamera& camera = *drawing.content.camera;
  const SE3& pose = space.cameras[static_cast<std::size_t>(space.current_camera)];
  View view;
  view.width = width;
  view.height = height;
  const Eigen::Matrix3d rotation = pose.rotation_matrix();
  view.axes.row(0) = rotation.col(0);
  view.axes.row(1) = -rotation.col(1);
  view.axes.row(2) = rotation.col(2);
  view.eye = pose.translation();
  const double by_width = 0.5 * camera.width / camera.fx * height / width;
  const double by_height = 0.5 * camera.height / camera.fy;
  view.half_angle = std::atan(std::max(by_width, by_height));
  view.distance = 0.5 * std::max(1.0, space.ahead.span());
  return view;
}

View free_view(const Drawing& drawing, int width, int height) {
  const FreeView& given = drawing.options.free_view;
  const SE3& placed = drawing.space.picture_from_reference;
  const Eigen::Matrix3d rotation = placed.rotation_matrix();
  View view;
  view.width = width;
  view.height = height;
  view.eye = placed * given.eye;
  const Eigen::Vector3d along = rotation * (given.target - given.eye);
  const Eigen::Vector3d right = along.cross(rotation * given.up);
  view.distance = along.norm();
  view.axes.row(2) = along.normalized();
  view.axes.row(0) = right.normalized();
  view.axes.row(1) = right.cross(along).normalized();
  view.half_angle = 0.5 * given.field_of_view;
  return view;
}

View side_view(int width, int height) {
  View view;
  view.width = width;
  view.height = height;
  view.parallel = true;
  view.axes.row(0) = Eigen::Vector3d::UnitY();  // ahead points right
  view.axes.row(1) = Eigen::Vector3d::UnitZ();
  view.axes.row(2) = -Eigen::Vector3d::UnitX();  // seen from the right
  return view;
}

/// A view with perspective: the oblique one, fitted to the content, or a given one.
Image perspective_picture(const Drawing& drawing, int width, int height) {
  const PictureSpace& space = drawing.space;
  const SceneView kind = drawing.options.view;
  const bool fitted = kind == SceneView::kOblique || kind == SceneView::kObliqueAndSide;
  const double unit = std::max(0.5, std::min(width / 1600.0, height / 620.0));
  const double text = 20.0 * unit;
  const Grid grid = make_grid(space);
  View view = kind == SceneView::kDriver ? driver_view(drawing, width, height)
              : kind == SceneView::kFree ? free_view(drawing, width, height)
                                         : oblique_view(drawing.options, width, height);
  const double top = drawing.content.title.empty() ? 2.2 * text : 3.9 * text;
  const double panel = space.has_color_bar ? 10.5 * text : 2.0 * text;
  const Box2 free{2.5 * text, top, width - panel, height - 3.6 * text};
  if (fitted) fit_view(fit_points(space, grid, false), free, &view);
  Image image = render_content(drawing, view, grid, unit);
  Canvas canvas(image);
  std::vector<Box2> taken;
  if (kind != SceneView::kDriver) {
    taken = draw_grid_numbers(canvas, space, view, grid, 0.8 * text);
  }

  if (!fitted) {
    canvas.rectangle({-1.0, -1.0, 1.0 * width, top - 0.5 * text}, kPaper.with_alpha(0.85));
  }
  double line = 1.1 * text;
  if (!drawing.content.title.empty()) {
    canvas.text({text, line}, drawing.content.title, 1.25 * text, kInk, TextAnchor::kLeft, true);
    line += 1.5 * text;
  }
  canvas.text_with_halo({text, line}, content_summary(drawing.content, space), text, kFaintInk,
                        kPaper);
  taken.push_back({0.0, 0.0, static_cast<double>(width), line + 0.6 * text});
  if (space.has_color_bar) {
    const double left = width - 9.2 * text;
    if (!fitted) {
      canvas.rectangle({left - 0.7 * text, top - 0.5 * text, 1.0 * width, height - 2.3 * text},
                       kPaper.with_alpha(0.85));
    }
    const double bar_top = top + 1.2 * text * static_cast<double>(space.color_title.size());
    const Box2 bar{left, bar_top, left + 1.2 * text,
                   std::min(height - 4.6 * text, top + 0.35 * width)};
    draw_color_bar(canvas, bar, space.color_range.low, space.color_range.high, space.color_title,
                   text, kInk);
    taken.push_back(
        {left - 0.5 * text, 0.0, static_cast<double>(width), static_cast<double>(height)});
  }
  std::vector<LegendEntry> legend =
      make_legend(space, drawing.content.camera ? "cameras and path" : "camera path");
  if (drawing.options.show_links && !space.links.empty()) {
    legend.push_back({LegendEntry::Mark::kLine, kLinkOrange, "link of patches"});
    legend.push_back({LegendEntry::Mark::kDashedLine, kLinkOrange, "link not used"});
  }
  if (!fitted) {
    canvas.rectangle({-1.0, height - 2.3 * text, 1.0 * width, 1.0 * height},
                     kPaper.with_alpha(0.85));
  }
  draw_legend(canvas, {text, height - 1.2 * text}, width - text, legend, text);
  taken.push_back(
      {0.0, height - 2.0 * text, static_cast<double>(width), static_cast<double>(height)});
  draw_vehicle_labels(canvas, space, view, taken, text, true);
  return image;
}

Image side_picture(const Drawing& drawing, int width, int height, bool alone) {
  const PictureSpace& space = drawing.space;
  const double unit = std::max(0.5, std::min(width / 1600.0, height / 260.0));
  const double text = 20.0 * std::min(unit, alone ? unit : width / 1600.0);
  const Grid grid = make_grid(space);
  View view = side_view(width, height);
  double top = 1.7 * text;
  if (alone && !drawing.content.title.empty()) top += 1.5 * text;
  const Box2 free{4.5 * text, top + 1.0 * text, width - 2.0 * text, height - 3.2 * text};
  fit_view(fit_points(space, grid, true), free, &view);
  Image image = render_content(drawing, view, grid, std::min(unit, text / 20.0));
  Canvas canvas(image);

  // Axes: the frame's edges in metres, lines of equal height through the picture.
  const double per_m = view.pixels_per_metre(Eigen::Vector3d::Zero());
  Eigen::Vector2d zero = Eigen::Vector2d::Zero();
  view.project(Eigen::Vector3d::Zero(), &zero);
  const auto to_x = [&](double ahead) { return zero.x() + per_m * ahead; };
  const auto to_y = [&](double z) { return zero.y() - per_m * z; };
  const Box2 frame{free.x1 - 0.5 * text, top, free.x2 + 0.5 * text, free.y2 + 0.6 * text};
  const double thin = std::max(1.0, text / 18.0);
  const double w = width, h = height;
  for (const Box2& outside : {Box2{-1, -1, w, frame.y1}, Box2{-1, frame.y2, w, h},
                              Box2{-1, -1, frame.x1, h}, Box2{frame.x2, -1, w, h}}) {
    canvas.rectangle(outside, kPaper);
  }
  const Ticks ahead = make_ticks((frame.x1 - zero.x()) / per_m, (frame.x2 - zero.x()) / per_m, 12);
  const Ticks heights = make_ticks((zero.y() - frame.y2) / per_m, (zero.y() - frame.y1) / per_m,
                                   std::max(1, static_cast<int>(frame.height() / (1.6 * text))));
  std::vector<Segment2> ticks, level;
  for (std::size_t i = 0; i < ahead.values.size(); ++i) {
    const double x = to_x(ahead.values[i]);
    ticks.push_back({{x, frame.y2}, {x, frame.y2 + 0.3 * text}});
    canvas.text({x, frame.y2 + 0.9 * text}, ahead.labels[i], 0.85 * text, kInk,
                TextAnchor::kCenter);
  }
  for (std::size_t i = 0; i < heights.values.size(); ++i) {
    const double y = to_y(heights.values[i]);
    ticks.push_back({{frame.x1 - 0.3 * text, y}, {frame.x1, y}});
    level.push_back({{frame.x1, y}, {frame.x2, y}});
    if (y < frame.y1 + 0.4 * text) continue;
    canvas.text({frame.x1 - 0.5 * text, y}, heights.labels[i], 0.85 * text, kInk,
                TextAnchor::kRight);
  }
  canvas.segments(level, thin, kFaintInk.with_alpha(0.25));
  canvas.segments(ticks, thin, kInk);
  canvas.polyline(
      {{frame.x1, frame.y1}, {frame.x2, frame.y1}, {frame.x2, frame.y2}, {frame.x1, frame.y2}},
      true, thin, kFaintInk);
  canvas.text({frame.center().x(), frame.y2 + 1.9 * text},
              space.ahead_name + " (" + space.unit + ")", 0.85 * text, kInk, TextAnchor::kCenter);
  canvas.text_upwards({frame.x1 - 3.2 * text, frame.center().y()}, "height (" + space.unit + ")",
                      0.85 * text, kInk);
  double line = 0.9 * text;
  if (alone && !drawing.content.title.empty()) {
    canvas.text({text, line}, drawing.content.title, 1.25 * text, kInk, TextAnchor::kLeft, true);
    line += 1.5 * text;
  }
  canvas.text({text, line},
              alone ? content_summary(drawing.content, space) : "from the side, true to scale",
              text, kFaintInk);
  draw_vehicle_labels(canvas, space, view,
                      {{0.0, 0.0, static_cast<double>(width), frame.y1},
                       {0.0, frame.y2, static_cast<double>(width), static_cast<double>(height)},
                       {0.0, 0.0, frame.x1, static_cast<double>(height)},
                       {frame.x2, 0.0, static_cast<double>(width), static_cast<double>(height)}},
                      0.85 * text, false);
  return image;
}

}  // namespace

void ScenePictureOptions::validate() const {
  check_picture_option("width", width, 64, 8192);
  check_picture_option("height", height, 64, 8192);
  check_picture_option("supersampling", supersampling, 1, 4);
  check_picture_option("point_size", point_size, 0.0, 20.0);
  check_picture_option("azimuth", azimuth, -10.0, 10.0);
  check_picture_option("elevation", elevation, 0.01, 1.55);
  check_picture_option("field of view", free_view.field_of_view, 0.01, 3.1);
  const Eigen::Vector3d along = free_view.target - free_view.eye;
  if (view == SceneView::kFree && !(along.cross(free_view.up).norm() > 1e-9)) {
    throw std::invalid_argument(
        "picture option free_view: found eye, target and up on one line or not finite, expected "
        "three directions that span a picture");
  }
  const int side = std::max(width, height) * supersampling;
  check_picture_option("supersampling times the longer side", side, 1, 16384);
}

Image render_scene_picture(const PictureContent& content, const ScenePictureOptions& options,
                           RenderRecord* record) {
  options.validate();
  const PictureSpace space = make_picture_space(content, options.show_truth, options.color);
  const Drawing drawing{content, space, options, record};
  if (options.view != SceneView::kSide && options.view != SceneView::kObliqueAndSide) {
    return perspective_picture(drawing, options.width, options.height);
  }
  if (options.view == SceneView::kSide) {
    return side_picture(drawing, options.width, options.height, true);
  }
  const int side_height = std::max(
      1, static_cast<int>(std::lround(std::min(0.3 * options.height, 0.3 * options.width))));
  const Image upper = perspective_picture(drawing, options.width, options.height - side_height);
  const Image lower = side_picture(drawing, options.width, side_height, false);
  Image both = make_picture(options.width, options.height, 255);
  std::copy(upper.data.begin(), upper.data.end(), both.data.begin());
  std::copy(lower.data.begin(), lower.data.end(),
            both.data.begin() + static_cast<std::ptrdiff_t>(upper.data.size()));
  return both;
}

}  // namespace camber
