#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/render/canvas.h"
#include "camber/render/color_map.h"
#include "camber/render/detail/vtk_drawing.h"
#include "camber/render/label_layout.h"
#include "camber/render/picture_file.h"
#include "camber/render/picture_legend.h"
#include "camber/render/picture_space.h"
#include "camber/render/pictures.h"
#include "camber/render/scene_camera.h"

namespace camber {
namespace {

struct Drawing {
  const PictureContent& content;
  const PictureSpace& space;
  const ScenePictureOptions& options;
  RenderRecord* record;
  KeptWindow* window;
  std::deque<bool>* covered;  ///< of the numbers along the grid, in order
  Color background = kPaper;

  bool shows(SceneElement element) const { return options.shows(element); }
};

/// Pixels of the 3D content without any text; lines of width one take `unit` pixels.
Image draw_content(const Drawing& drawing, const SceneCamera& view, const SceneGrid& grid,
                   double unit) {
  return render_scene_content(
      {drawing.content, drawing.space, drawing.options, view, grid, drawing.background, unit},
      drawing.window, drawing.record);
}

/// Ids and distances beside the vehicles.
void draw_vehicle_labels(Canvas& canvas, const PictureSpace& space, const SceneCamera& view,
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

/// Whether something darker than the grid's lines is drawn in a box, over white.
bool is_covered(const Image& image, const Box2& box) {
  const int x1 = std::max(0, static_cast<int>(box.x1)), y1 = std::max(0, static_cast<int>(box.y1));
  const int x2 = std::min(image.width, static_cast<int>(box.x2) + 1);
  const int y2 = std::min(image.height, static_cast<int>(box.y2) + 1);
  int inked = 0;
  for (int y = y1; y < y2; ++y) {
    for (int x = x1; x < x2; ++x) {
      const std::uint8_t* p = image.row(y) + 3 * x;
      inked += std::min({p[0], p[1], p[2]}) < 195;
    }
  }
  return inked * 50 > (x2 - x1) * (y2 - y1);
}

/// Numbers along two sides of the level grid, where nothing is drawn; returns what they cover.
std::vector<Box2> draw_grid_numbers(Canvas& canvas, const Image& image, const Drawing& drawing,
                                    const SceneCamera& view, const SceneGrid& grid,
                                    double text_size) {
  const PictureSpace& space = drawing.space;
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
    // Over black the same numbers are left out as over white.
    if (drawing.background.red == 255) {
      drawing.covered->push_back(is_covered(image, box));
    } else {
      drawing.covered->push_back(drawing.covered->front());
      drawing.covered->pop_front();
    }
    if (drawing.covered->back()) return;
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
  // Beyond the numbers: as far out as their letters reach along the picture's rows.
  const auto name_axis = [&](const Eigen::Vector3d& middle, const Eigen::Vector3d& outwards,
                             const std::vector<std::string>& numbers, const std::string& name) {
    double widest = 0.0;
    for (const std::string& number : numbers) {
      widest = std::max(widest, Canvas::text_size(number, text_size).x());
    }
    Eigen::Vector2d p, q;
    if (!view.project(middle, &p) || !view.project(middle + outwards, &q)) return;
    const double across = std::abs((q - p).normalized().x());
    // Whole coordinates of a map are long.
    const double far =
        std::max(2.6 * text_size, space.map ? 1.9 * text_size + widest * across : 0.0);
    write(middle + outwards * (far / view.pixels_per_metre(middle)), outwards,
          name + " (" + space.unit + ")");
  };
  name_axis({x, 0.5 * (grid.y1 + grid.y2), grid.z}, out_x, grid.ys.labels,
            space.map ? space.ahead_name : "ahead");
  name_axis({0.5 * (grid.x1 + grid.x2), y, grid.z}, out_y, grid.xs.labels,
            space.map ? space.right_name : "right");
  return taken;
}

/// A vertical axis on the grid's corner that is farthest to the left; adds what it covers.
void draw_height_axis(Canvas& canvas, const PictureSpace& space, const SceneCamera& view,
                      const SceneGrid& grid, double text_size, std::vector<Box2>* taken) {
  Eigen::Vector2d foot(1e30, 0.0), head;
  Eigen::Vector3d corner = Eigen::Vector3d::Zero();
  for (const double x : {grid.x1, grid.x2}) {
    for (const double y : {grid.y1, grid.y2}) {
      Eigen::Vector2d p;
      if (!view.project({x, y, grid.z}, &p)) return;
      if (p.x() >= foot.x()) continue;
      foot = p;
      corner = {x, y, grid.z};
    }
  }
  const double top = space.up.high;
  if (!view.project({corner.x(), corner.y(), top}, &head)) return;
  const double length = (foot - head).norm();
  const Eigen::Vector2d name = Canvas::text_size("height (" + space.unit + ")", text_size);
  if (length < 2.0 * text_size || head.x() - 0.5 * name.x() < 4.0 || foot.y() < head.y()) return;
  std::vector<Segment2> lines = {{foot, head}};
  std::vector<std::pair<Eigen::Vector2d, std::string>> numbers;
  std::vector<Box2> covered;
  const Ticks ticks = make_ticks(
      grid.z, top, std::max(2, static_cast<int>(length / (2.2 * text_size))), space.origin.z());
  for (std::size_t i = 0; i < ticks.values.size(); ++i) {
    Eigen::Vector2d p;
    if (!view.project({corner.x(), corner.y(), ticks.values[i]}, &p)) continue;
    const Eigen::Vector2d size = Canvas::text_size(ticks.labels[i], text_size);
    const Eigen::Vector2d at = p - Eigen::Vector2d(0.55 * text_size, 0.0);
    const Box2 box{at.x() - size.x(), at.y() - 0.5 * size.y(), at.x(), at.y() + 0.5 * size.y()};
    const bool free = std::none_of(taken->begin(), taken->end(), [&](const Box2& other) {
      return box.x1 < other.x2 && box.x2 > other.x1 && box.y1 < other.y2 && box.y2 > other.y1;
    });
    if (!free || box.x1 < 2.0 || (!covered.empty() && box.y2 > covered.back().y1)) continue;
    lines.push_back({p, p - Eigen::Vector2d(0.35 * text_size, 0.0)});
    numbers.emplace_back(at, ticks.labels[i]);
    covered.push_back(box);
  }
  if (numbers.size() < 2) return;  // nothing to show
  canvas.segments(lines, std::max(1.0, text_size / 16.0), kFaintInk);
  for (const auto& [at, number] : numbers) {
    canvas.text(at, number, text_size, kFaintInk, TextAnchor::kRight);
  }
  const Eigen::Vector2d at(head.x(), head.y() - 0.9 * text_size);
  canvas.text(at, "height (" + space.unit + ")", text_size, kFaintInk, TextAnchor::kCenter);
  covered.push_back({at.x() - 0.5 * name.x(), at.y() - 0.5 * name.y(), at.x() + 0.5 * name.x(),
                     at.y() + 0.5 * name.y()});
  taken->insert(taken->end(), covered.begin(), covered.end());
}

/// A bar as long as a cell of the grid is across the view in the content's middle; from `at`, its
/// left end, where nothing else is written.
void draw_scale_bar(Canvas& canvas, const PictureSpace& space, const SceneCamera& view,
                    const SceneGrid& grid, const Eigen::Vector2d& at, double text_size,
                    std::vector<Box2>* taken) {
  const Eigen::Vector3d middle(0.5 * (grid.x1 + grid.x2), 0.5 * (grid.y1 + grid.y2),
                               0.5 * (space.up.low + space.up.high));
  const double length = grid.xs.step * view.pixels_per_metre(middle);
  const std::string name = format_step(grid.xs.step) + " " + space.unit + " in the middle";
  const Eigen::Vector2d end = at + Eigen::Vector2d(length, 0.0);
  const double height = 0.25 * text_size;
  const double right = end.x() + 0.5 * text_size + Canvas::text_size(name, 0.8 * text_size).x();
  const Box2 box{at.x(), at.y() - 2.0 * height, right, at.y() + 2.0 * height};
  for (const Box2& other : *taken) {
    if (box.x1 < other.x2 && box.x2 > other.x1 && box.y1 < other.y2 && box.y2 > other.y1) return;
  }
  if (right > 0.5 * canvas.width()) return;
  const Eigen::Vector2d up(0.0, height);
  canvas.segments({{at, end}, {at - up, at + up}, {end - up, end + up}},
                  std::max(1.0, text_size / 12.0), kInk);
  canvas.text(end + Eigen::Vector2d(0.5 * text_size, 0.0), name, 0.8 * text_size, kInk);
  taken->push_back(box);
}

/// The marks of what is shown, and how large the grid's cells are.
std::vector<LegendEntry> scene_legend(const Drawing& drawing, const SceneGrid& grid,
                                      bool grid_shown) {
  const PictureSpace& space = drawing.space;
  PictureSpace shown;  // only what the legend asks about
  if (drawing.shows(SceneElement::kPoints)) shown.classes = space.classes;
  if (drawing.shows(SceneElement::kPatches)) shown.patches = space.patches;
  if (drawing.shows(SceneElement::kVehicles) || drawing.shows(SceneElement::kBoxes)) {
    shown.vehicles = space.vehicles;
  }
  if (drawing.shows(SceneElement::kTruth)) shown.truth = space.truth;
  if (drawing.shows(SceneElement::kTruthCloud) && !space.truth_points.empty()) {
    shown.truth_points.resize(1);
  }
  if (drawing.shows(SceneElement::kCameras) && drawing.options.view != SceneView::kDriver) {
    shown.cameras = space.cameras;
  }
  std::vector<LegendEntry> legend =
      make_legend(shown, drawing.content.camera ? "cameras and path" : "camera path");
  using Mark = LegendEntry::Mark;
  if (drawing.shows(SceneElement::kLinks)) {
    const auto any = [&](bool valid) {
      return std::any_of(space.links.begin(), space.links.end(),
                         [&](const PlacedLink& link) { return link.valid == valid; });
    };
    if (any(true)) legend.push_back({Mark::kLine, plasma(0.3), "link of patches"});
    if (any(false)) legend.push_back({Mark::kDashedLine, kInk, "link not used"});
  }
  if (grid_shown) {
    legend.push_back({Mark::kLine,
                      {180, 185, 192, 1.0},
                      "grid of " + format_step(grid.xs.step) + " " + space.unit});
  }
  return legend;
}

bool any_in_view(const std::vector<Eigen::Vector3f>& points, const SceneCamera& view) {
  return std::any_of(points.begin(), points.end(), [&](const Eigen::Vector3f& point) {
    Eigen::Vector2d p = Eigen::Vector2d::Zero();
    return view.project(point.cast<double>(), &p) && p.x() >= -0.5 && p.y() >= -0.5 &&
           p.x() <= view.width - 0.5 && p.y() <= view.height - 0.5;
  });
}

/// A view with perspective: the oblique one, fitted to the content, or a given one.
Image perspective_picture(const Drawing& drawing, int width, int height) {
  const PictureSpace& space = drawing.space;
  const SceneView kind = drawing.options.view;
  const bool fitted = kind == SceneView::kOblique || kind == SceneView::kObliqueAndSide;
  const double unit = std::max(0.5, std::min(width / 1600.0, height / 620.0));
  const double text = 20.0 * unit;
  const SceneGrid grid = make_scene_grid(space);
  SceneCamera view =
      kind == SceneView::kDriver ? driver_camera(drawing.content, space, width, height)
      : kind == SceneView::kFree
          ? free_camera(space, drawing.options.free_view, width, height)
          : oblique_camera(drawing.options.azimuth, drawing.options.elevation, width, height);
  if (drawing.record && kind == SceneView::kFree) {
    drawing.record->none_in_view = !space.points.empty() && !any_in_view(space.points, view);
  }
  const bool grid_shown = kind != SceneView::kDriver && drawing.shows(SceneElement::kGrid);
  const bool links_shown = drawing.shows(SceneElement::kLinks) && !space.links.empty();
  const double top = drawing.content.title.empty() ? 2.2 * text : 3.9 * text;
  const bool color_bar = space.has_color_bar && drawing.shows(SceneElement::kPoints);
  const bool bars = color_bar || links_shown;
  const double panel = bars ? 10.5 * text : 2.0 * text;
  const std::vector<LegendEntry> legend = scene_legend(drawing, grid, grid_shown);
  const int legend_rows = count_legend_rows(width - 2.0 * text, legend, text);
  const double bottom = height - 0.6 * text - legend_height(legend_rows, text);
  const Box2 free{(grid_shown ? 4.0 : 2.5) * text, top + (grid_shown ? 1.2 * text : 0.0),
                  width - panel - (grid_shown ? 1.5 * text : 0.0), bottom - 1.7 * text};
  if (fitted) {
    std::vector<Eigen::Vector3d> corners = content_corners(space, grid, false);
    if (drawing.options.turning) {
      for (const double x : {grid.x1, grid.x2}) {  // where the height axis may stand
        for (const double y : {grid.y1, grid.y2}) corners.emplace_back(x, y, space.up.high);
      }
      corners = swept_all_around(corners, space.up.high);
    }
    fit_camera(corners, free, &view);
  }
  Image image = draw_content(drawing, view, grid, unit);
  Canvas canvas(image);
  std::vector<Box2> taken;
  if (grid_shown) {
    taken = draw_grid_numbers(canvas, image, drawing, view, grid, 0.8 * text);
    if (fitted) {
      draw_height_axis(canvas, space, view, grid, 0.8 * text, &taken);
      draw_scale_bar(canvas, space, view, grid, {text, bottom - 0.7 * text}, text, &taken);
    }
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
                        drawing.background);
  taken.push_back({0.0, 0.0, static_cast<double>(width), line + 0.6 * text});
  if (bars) {
    const double left = width - 9.2 * text;
    if (!fitted) {
      canvas.rectangle({left - 0.7 * text, top - 0.5 * text, 1.0 * width, bottom},
                       kPaper.with_alpha(0.85));
    }
    const std::vector<std::string> link_title = {"height step", "of a link (" + space.unit + ")"};
    const double lowest = std::min(bottom - 1.3 * text, top + 0.4 * width);
    const bool both = color_bar && links_shown;
    double bar_top = top;
    if (color_bar) {
      bar_top += 1.2 * text * static_cast<double>(space.color_title.size());
      const double bar_bottom = both ? 0.5 * (top + lowest) - 0.4 * text : lowest;
      draw_color_bar(canvas, {left, bar_top, left + 1.2 * text, bar_bottom}, space.color_range.low,
                     space.color_range.high, space.color_title, text, kInk, space.color_scale);
      bar_top = bar_bottom + 0.8 * text;
    }
    if (links_shown) {
      bar_top += 1.2 * text * static_cast<double>(link_title.size());
      draw_color_bar(canvas, {left, bar_top, left + 1.2 * text, lowest}, 0.0, space.link_steps.high,
                     link_title, text, kInk, plasma);
    }
    taken.push_back(
        {left - 0.5 * text, 0.0, static_cast<double>(width), static_cast<double>(height)});
  }
  if (!fitted) {
    canvas.rectangle({-1.0, bottom, 1.0 * width, 1.0 * height}, kPaper.with_alpha(0.85));
  }
  draw_legend(canvas, {text, bottom + 0.65 * text}, width - text, legend, text);
  taken.push_back({0.0, bottom, static_cast<double>(width), static_cast<double>(height)});
  if (drawing.shows(SceneElement::kVehicles) || drawing.shows(SceneElement::kBoxes)) {
    draw_vehicle_labels(canvas, space, view, taken, text, true);
  }
  return image;
}

Image side_picture(const Drawing& drawing, int width, int height, bool alone) {
  const PictureSpace& space = drawing.space;
  const double unit = std::max(0.5, std::min(width / 1600.0, height / 260.0));
  const double text = 20.0 * std::min(unit, alone ? unit : width / 1600.0);
  const SceneGrid grid = make_scene_grid(space);
  SceneCamera view = side_camera(space, width, height);
  double top = 1.7 * text;
  if (alone && !drawing.content.title.empty()) top += 1.5 * text;
  const Box2 free{4.5 * text, top + 1.0 * text, width - 2.0 * text, height - 3.2 * text};
  fit_camera(content_corners(space, grid, true), free, &view);
  Image image = draw_content(drawing, view, grid, std::min(unit, text / 20.0));
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
    canvas.rectangle(outside, drawing.background);
  }
  const double from = side_looks_north(space) ? space.origin.x() : space.origin.y();
  const Ticks ahead =
      make_ticks((frame.x1 - zero.x()) / per_m, (frame.x2 - zero.x()) / per_m, 12, from);
  const Ticks heights =
      make_ticks((zero.y() - frame.y2) / per_m, (zero.y() - frame.y1) / per_m,
                 std::max(1, static_cast<int>(frame.height() / ((alone ? 3.2 : 1.6) * text))),
                 space.origin.z());
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
  canvas.text(
      {frame.center().x(), frame.y2 + 1.9 * text},
      (side_looks_north(space) ? space.right_name : space.ahead_name) + " (" + space.unit + ")",
      0.85 * text, kInk, TextAnchor::kCenter);
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

namespace {

Image compose(const Drawing& drawing) {
  const ScenePictureOptions& options = drawing.options;
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

/// The picture that gives `on_white` over white and `on_black` over black.
Image with_alpha_channel(const Image& on_white, const Image& on_black) {
  Image out;
  out.width = on_white.width;
  out.height = on_white.height;
  out.channels = 4;
  out.data.resize(on_white.data.size() / 3 * 4);
  for (std::size_t i = 0; i < on_white.data.size() / 3; ++i) {
    const std::uint8_t* white = &on_white.data[3 * i];
    const std::uint8_t* black = &on_black.data[3 * i];
    int through = 255;
    for (int c = 0; c < 3; ++c) through = std::min(through, std::max(0, white[c] - black[c]));
    const int alpha = 255 - through;
    for (int c = 0; c < 3; ++c) {
      const int ink = alpha == 0 ? 255 : std::min(255, (black[c] * 255 + alpha / 2) / alpha);
      out.data[4 * i + static_cast<std::size_t>(c)] = static_cast<std::uint8_t>(ink);
    }
    out.data[4 * i + 3] = static_cast<std::uint8_t>(alpha);
  }
  return out;
}

}  // namespace

Image render_scene_picture(const PictureContent& content, const ScenePictureOptions& options,
                           RenderRecord* record) {
  options.validate();
  const PictureSpace space = make_picture_space(content, options.show_truth, options.color);
  KeptWindow window;
  std::deque<bool> covered;
  const Image on_white = compose({content, space, options, record, &window, &covered});
  if (!options.transparent) return on_white;
  return with_alpha_channel(
      on_white, compose({content, space, options, record, &window, &covered, {0, 0, 0, 1.0}}));
}

}  // namespace camber
