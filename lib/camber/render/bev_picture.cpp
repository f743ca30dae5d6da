#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "camber/render/color_map.h"
#include "camber/render/label_layout.h"
#include "camber/render/picture_file.h"
#include "camber/render/picture_legend.h"
#include "camber/render/picture_space.h"
#include "camber/render/pictures.h"
#include "camber/render/scene_actors.h"

namespace camber {
namespace {

constexpr double kChiSquare95 = 5.991464547107979;  // two degrees of freedom

/// From the picture frame to pixels: ahead points right, right points down; of a map, x points
/// right and y up.
struct Map {
  bool north_up = false;
  double scale = 1.0;          // pixels a metre
  Eigen::Vector2d zero{0, 0};  // pixel of (right 0, ahead 0)

  Eigen::Vector2d operator()(double right, double ahead) const {
    if (north_up) return {zero.x() + scale * right, zero.y() - scale * ahead};
    return {zero.x() + scale * ahead, zero.y() + scale * right};
  }
  Eigen::Vector2d operator()(const Eigen::Vector3d& x) const { return (*this)(x.x(), x.y()); }
};

/// Points as squares of `size` pixels, the highest on top, anti-aliased by a twofold raster.
void splat_points(Image& image, const PictureSpace& space, const Map& map, const Box2& frame,
                  double size) {
  constexpr int kFactor = 2;
  const int x0 = static_cast<int>(std::floor(frame.x1)),
            y0 = static_cast<int>(std::floor(frame.y1));
  const int width = static_cast<int>(std::ceil(frame.x2)) - x0;
  const int height = static_cast<int>(std::ceil(frame.y2)) - y0;
  if (width <= 0 || height <= 0) return;
  cv::Mat place(image.height, image.width, CV_8UC3, image.data.data());
  cv::Mat area = place(cv::Rect(x0, y0, width, height));
  cv::Mat large;
  cv::resize(area, large, cv::Size(), kFactor, kFactor, cv::INTER_NEAREST);
  std::vector<float> top(static_cast<std::size_t>(large.cols) * large.rows,
                         -std::numeric_limits<float>::infinity());
  const int side = std::max(1, static_cast<int>(std::lround(size * kFactor)));
  for (std::size_t i = 0; i < space.points.size(); ++i) {
    const Eigen::Vector3f& p = space.points[i];
    const Eigen::Vector2d pixel = map(p.x(), p.y());
    const double px = (pixel.x() - x0 + 0.5) * kFactor - 0.5 * side;
    const double py = (pixel.y() - y0 + 0.5) * kFactor - 0.5 * side;
    if (!(px > -1e6 && px < 1e6 && py > -1e6 && py < 1e6)) continue;
    const int left = static_cast<int>(std::lround(px)), upper = static_cast<int>(std::lround(py));
    const cv::Vec3b ink(space.colors[i][0], space.colors[i][1], space.colors[i][2]);
    for (int y = std::max(0, upper); y < std::min(large.rows, upper + side); ++y) {
      for (int x = std::max(0, left); x < std::min(large.cols, left + side); ++x) {
        float& before = top[static_cast<std::size_t>(y) * large.cols + x];
        if (p.z() <= before) continue;
        before = p.z();
        large.at<cv::Vec3b>(y, x) = ink;
      }
    }
  }
  cv::resize(large, area, area.size(), 0, 0, cv::INTER_AREA);
}

std::vector<Eigen::Vector2d> footprint(const PlacedVehicle& vehicle, const Map& map) {
  const auto corners = vehicle.box.corners();
  std::vector<Eigen::Vector2d> out;
  for (int i = 0; i < 4; ++i) out.push_back(map(corners.col(i)));
  return out;
}

/// From the middle of a vehicle to its front: its heading.
Segment2 heading(const PlacedVehicle& vehicle, const Map& map) {
  const SE3& pose = vehicle.box.camera_from_vehicle;
  return {map(pose.translation()),
          map(pose * Eigen::Vector3d(0.5 * vehicle.box.dimensions.length, 0.0, 0.0))};
}

/// 95 % of the position's probability; empty where no covariance is stated, or one that reaches as
/// far as the camera and shows nothing.
std::vector<Eigen::Vector2d> ellipse(const PlacedVehicle& vehicle, const Map& map) {
  const Eigen::Matrix2d covariance = vehicle.center_covariance.topLeftCorner<2, 2>();
  if (!covariance.allFinite() || !(covariance.trace() > 0.0)) return {};
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(
      0.5 * (covariance + covariance.transpose()));
  if (solver.info() != Eigen::Success) return {};
  const Eigen::Vector2d axes = (kChiSquare95 * solver.eigenvalues().cwiseMax(0.0)).cwiseSqrt();
  if (!(axes.maxCoeff() < std::max(vehicle.range, 1e-9))) return {};
  const Eigen::Vector3d center = vehicle.box.center();
  std::vector<Eigen::Vector2d> rim;
  constexpr int kSteps = 72;
  for (int i = 0; i < kSteps; ++i) {
    const double angle = 2.0 * M_PI * i / kSteps;
    const Eigen::Vector2d offset =
        solver.eigenvectors() *
        Eigen::Vector2d(axes.x() * std::cos(angle), axes.y() * std::sin(angle));
    rim.push_back(map(center.x() + offset.x(), center.y() + offset.y()));
  }
  return rim;
}

Box2 bounds(const std::vector<Eigen::Vector2d>& points) {
  Box2 box{1e30, 1e30, -1e30, -1e30};
  for (const Eigen::Vector2d& p : points) {
    box = {std::min(box.x1, p.x()), std::min(box.y1, p.y()), std::max(box.x2, p.x()),
           std::max(box.y2, p.y())};
  }
  return box;
}

}  // namespace

void BevPictureOptions::validate() const {
  check_picture_option("width", width, 64, 8192);
  check_picture_option("height", height, 64, 8192);
  check_picture_option("point_size", point_size, 0.0, 20.0);
}

Image render_bev_picture(const PictureContent& content, const BevPictureOptions& options) {
  options.validate();
  PictureSpace space = make_picture_space(content, options.show_truth, options.color);
  const std::string summary = content_summary(content, space);
  // What is not shown is taken out; the frame stays.
  if (!options.show_points) {
    space.points.clear();
    space.colors.clear();
    space.has_color_bar = false;
  }
  if (!options.show_truth_cloud) space.truth_points.clear();
  if (!options.show_patches) space.patches.clear();
  if (!options.show_vehicles) space.vehicles.clear();
  if (!options.show_cameras) {
    space.cameras.clear();
    space.current_camera = -1;
  }
  const int width = options.width, height = options.height;
  const double unit = std::max(0.5, std::min(width / 1600.0, height / 900.0));
  const double text = 20.0 * unit;
  Image image = make_picture(width, height, 255);
  Canvas canvas(image);

  const bool links_shown = options.show_links && !space.links.empty();
  std::vector<LegendEntry> legend = make_legend(space, "camera path");
  using Mark = LegendEntry::Mark;
  const bool any_ellipse =
      std::any_of(space.vehicles.begin(), space.vehicles.end(),
                  [](const PlacedVehicle& vehicle) { return !ellipse(vehicle, Map()).empty(); });
  if (any_ellipse) legend.push_back({Mark::kEllipse, kInk, "95 % of its position"});
  if (content.camera && space.current_camera >= 0) {
    legend.push_back({Mark::kDashedLine, kInk, "field of view"});
  }
  for (const bool valid : {true, false}) {
    const bool any =
        links_shown && std::any_of(space.links.begin(), space.links.end(),
                                   [&](const PlacedLink& link) { return link.valid == valid; });
    if (any && valid) legend.push_back({Mark::kLine, plasma(0.3), "link of patches"});
    if (any && !valid) legend.push_back({Mark::kDashedLine, kInk, "link not used"});
  }
  const double legend_top =
      height - 0.6 * text -
      legend_height(count_legend_rows(width - 2.0 * text, legend, text), text);

  // The plot's frame, and a map that fits the content into it without distortion.
  const double top = content.title.empty() ? 2.2 * text : 3.8 * text;
  const bool bars = space.has_color_bar || links_shown;
  const Box2 frame{4.4 * text, top, width - (bars ? 10.5 : 1.5) * text, legend_top - 3.3 * text};
  const double pad = 1.2 * text;
  Map map;
  map.north_up = space.map;
  // What runs along the picture's columns and rows.
  const RobustRange& across = space.map ? space.right : space.ahead;
  const RobustRange& down = space.map ? space.ahead : space.right;
  const double down_sign = space.map ? -1.0 : 1.0;
  map.scale = std::min((frame.width() - 2.0 * pad) / std::max(across.span(), 1e-3),
                       (frame.height() - 2.0 * pad) / std::max(down.span(), 1e-3));
  map.scale = std::max(map.scale, 1e-6);
  map.zero = {frame.center().x() - map.scale * 0.5 * (across.low + across.high),
              frame.center().y() - down_sign * map.scale * 0.5 * (down.low + down.high)};
  const auto column = [&](double value) { return map.zero.x() + map.scale * value; };
  const auto row = [&](double value) { return map.zero.y() + down_sign * map.scale * value; };
  const RobustRange shown_across{(frame.x1 - map.zero.x()) / map.scale,
                                 (frame.x2 - map.zero.x()) / map.scale};
  const double edge1 = down_sign * (frame.y1 - map.zero.y()) / map.scale;
  const double edge2 = down_sign * (frame.y2 - map.zero.y()) / map.scale;
  // One grid spacing for both axes, so that the grid's cells are squares.
  const double step = make_ticks(shown_across.low, shown_across.high,
                                 std::max(2, static_cast<int>(frame.width() / (5.0 * text))))
                          .step;
  const Ticks column_ticks = multiples_of(step, shown_across.low, shown_across.high);
  const Ticks row_ticks = multiples_of(step, std::min(edge1, edge2), std::max(edge1, edge2));
  const double thin = std::max(1.0, unit);

  std::vector<Segment2> grid;
  for (const double at : column_ticks.values) {
    const double x = column(at);
    grid.push_back({{x, frame.y1}, {x, frame.y2}});
  }
  for (const double at : row_ticks.values) {
    const double y = row(at);
    grid.push_back({{frame.x1, y}, {frame.x2, y}});
  }
  canvas.segments(grid, thin, {222, 225, 229, 1.0});

  if (!space.truth_points.empty()) {
    PictureSpace truth;
    truth.points = space.truth_points;
    truth.colors.assign(truth.points.size(), {kTruthGrey.red, kTruthGrey.green, kTruthGrey.blue});
    splat_points(image, truth, map, frame, 1.4 * unit);
  }
  if (!space.points.empty()) {
    double size = options.point_size;
    if (size <= 0.0) {
      const double area = std::max(1e-6, space.right.span() * space.ahead.span());
      const double spacing = std::sqrt(area / static_cast<double>(space.points.size()));
      size = std::clamp(0.7 * spacing * map.scale / unit, 1.4, 3.0) * unit;
    }
    splat_points(image, space, map, frame, size);
    canvas.segments(grid, thin, {255, 255, 255, 0.25});
  }

  // The camera's field of view: its image's left and right edges.
  if (content.camera && space.current_camera >= 0) {
    const SE3& camera = space.cameras[static_cast<std::size_t>(space.current_camera)];
    const double far = 3.0 * (space.ahead.span() + space.right.span() + 10.0);
    std::vector<Segment2> edges;
    for (const double u : {-0.5, content.camera->width - 0.5}) {
      const Eigen::Vector3d ray = content.camera->ray({u, content.camera->cy}) * far;
      Segment2 edge{map(camera.translation()), map(camera * ray)};
      if (clip_segment(frame, &edge.first, &edge.second)) edges.push_back(edge);
    }
    canvas.dashed(edges, 0.5 * text, 0.3 * text, 1.2 * unit, kInk.with_alpha(0.7));
  }
  for (const PlacedPatch& patch : space.patches) {
    std::vector<Eigen::Vector2d> rim;
    for (const Eigen::Vector3d& corner : patch.boundary) rim.push_back(map(corner));
    canvas.polygon(rim, kPaper.with_alpha(0.25));
    canvas.polyline(rim, true, 3.4 * unit, kPaper.with_alpha(0.8));
    canvas.polyline(rim, true, 2.0 * unit, patch_color(patch.kind));
  }
  if (links_shown) {
    std::vector<Segment2> invalid;
    for (const PlacedLink& link : space.links) {
      const Segment2 line{map(link.a), map(link.b)};
      if (!link.valid) {
        invalid.push_back(line);
        continue;
      }
      canvas.segments({line}, 5.0 * unit, kPaper.with_alpha(0.8));
      canvas.segments({line}, 3.0 * unit, link_color(link, space));
    }
    canvas.dashed(invalid, 0.4 * text, 0.3 * text, 1.6 * unit, kInk);
  }
  for (const PlacedVehicle& vehicle : space.vehicles) {
    const Color color = vehicle_color(vehicle);
    const std::vector<Eigen::Vector2d> rim = footprint(vehicle, map);
    canvas.polygon(rim, color.with_alpha(0.8));
    canvas.polyline(rim, true, 2.0 * unit, darker(color, 0.45));
    canvas.segments({heading(vehicle, map)}, 2.0 * unit, darker(color, 0.45));
    const std::vector<Eigen::Vector2d> region = ellipse(vehicle, map);
    canvas.polyline(region, true, 2.6 * unit, kPaper.with_alpha(0.8));
    canvas.polyline(region, true, 1.4 * unit, kInk);
  }
  for (const PlacedVehicle& vehicle : space.truth) {
    canvas.polyline(footprint(vehicle, map), true, 2.0 * unit, kTruthRed);
    canvas.segments({heading(vehicle, map)}, 2.0 * unit, kTruthRed);
  }
  std::vector<Eigen::Vector2d> path;
  for (const SE3& camera : space.cameras) path.push_back(map(camera.translation()));
  canvas.polyline(path, false, 3.0 * unit, kInk);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const bool current = static_cast<int>(i) == space.current_camera;
    canvas.disc(path[i], (current ? 6.0 : 3.5) * unit, kInk);
    if (current) canvas.disc(path[i], 3.0 * unit, kPaper);
  }

  // What reaches outside of the frame is wiped before the axes are drawn.
  const double w = width, h = height;
  for (const Box2& outside : {Box2{-1, -1, w, frame.y1}, Box2{-1, frame.y2, w, h},
                              Box2{-1, -1, frame.x1, h}, Box2{frame.x2, -1, w, h}}) {
    canvas.rectangle(outside, kPaper);
  }
  canvas.polyline(
      {{frame.x1, frame.y1}, {frame.x2, frame.y1}, {frame.x2, frame.y2}, {frame.x1, frame.y2}},
      true, thin, kFaintInk);
  for (std::size_t i = 0; i < column_ticks.values.size(); ++i) {
    const double x = column(column_ticks.values[i]);
    canvas.segments({{{x, frame.y2}, {x, frame.y2 + 0.3 * text}}}, thin, kInk);
    canvas.text({x, frame.y2 + 0.95 * text}, column_ticks.labels[i], text, kInk,
                TextAnchor::kCenter);
  }
  for (std::size_t i = 0; i < row_ticks.values.size(); ++i) {
    const double y = row(row_ticks.values[i]);
    canvas.segments({{{frame.x1 - 0.3 * text, y}, {frame.x1, y}}}, thin, kInk);
    canvas.text({frame.x1 - 0.5 * text, y}, row_ticks.labels[i], text, kInk, TextAnchor::kRight);
  }
  canvas.text({frame.center().x(), frame.y2 + 2.1 * text},
              (space.map ? space.right_name : space.ahead_name) + " (" + space.unit + ")", text,
              kInk, TextAnchor::kCenter);
  canvas.text_upwards(
      {1.2 * text, frame.center().y()},
      (space.map ? space.ahead_name : "left  -  " + space.right_name) + " (" + space.unit + ")",
      text, kInk);

  double line = 1.1 * text;
  if (!content.title.empty()) {
    canvas.text({text, line}, content.title, 1.25 * text, kInk, TextAnchor::kLeft, true);
    line += 1.5 * text;
  }
  canvas.text({text, line}, summary, text, kFaintInk);
  const double bar_left = width - 9.2 * text;
  if (space.has_color_bar) {
    const double bar_top = frame.y1 + 1.2 * text * static_cast<double>(space.color_title.size());
    const double bar_bottom = links_shown ? frame.center().y() - 0.4 * text : frame.y2;
    draw_color_bar(canvas, {bar_left, bar_top, bar_left + 1.2 * text, bar_bottom},
                   space.color_range.low, space.color_range.high, space.color_title, text, kInk,
                   space.color_scale);
  }
  if (links_shown) {
    const double start = space.has_color_bar ? frame.center().y() + 0.4 * text : frame.y1;
    draw_color_bar(canvas, {bar_left, start + 2.4 * text, bar_left + 1.2 * text, frame.y2}, 0.0,
                   space.link_steps.high, {"height step", "of a link (" + space.unit + ")"}, text,
                   kInk, plasma);
  }
  draw_legend(canvas, {text, legend_top + 0.65 * text}, width - text, legend, text);

  // Scale bar, as long as a cell of the grid.
  const Eigen::Vector2d bar_end(frame.x2 - 0.8 * text, frame.y2 - 0.9 * text);
  const Eigen::Vector2d bar_start = bar_end - Eigen::Vector2d(map.scale * step, 0.0);
  const std::string bar_text = format_step(step) + " " + space.unit;
  const double bar_text_width = Canvas::text_size(bar_text, text, true).x();
  const double plate_left =
      std::min(bar_start.x(), 0.5 * (bar_start.x() + bar_end.x()) - 0.5 * bar_text_width);
  const Box2 plate{plate_left - 0.5 * text, bar_end.y() - 1.9 * text, frame.x2 - 0.3 * text,
                   frame.y2 - 0.3 * text};
  canvas.rectangle(plate, kPaper.with_alpha(0.85), 0.2 * text);
  canvas.segments(
      {{bar_start, bar_end},
       {bar_start - Eigen::Vector2d(0, 0.3 * text), bar_start + Eigen::Vector2d(0, 0.3 * text)},
       {bar_end - Eigen::Vector2d(0, 0.3 * text), bar_end + Eigen::Vector2d(0, 0.3 * text)}},
      2.0 * unit, kInk);
  canvas.text({0.5 * (bar_start.x() + bar_end.x()), bar_end.y() - 1.0 * text}, bar_text, text, kInk,
              TextAnchor::kCenter, true);

  // Labels last: they cover what they must.
  std::vector<LabelRequest> requests;
  std::vector<const PlacedVehicle*> named;
  LabelLayoutOptions layout;
  layout.area = frame.grown(-2.0);
  layout.gap = 0.25 * text;
  layout.taken = {plate};
  for (const PlacedVehicle& vehicle : space.vehicles) {
    const Box2 reach = bounds(footprint(vehicle, map));
    layout.avoid.push_back(reach);
    if (!frame.contains(reach.center())) continue;
    const std::string label =
        vehicle.name + "  " + format_number(vehicle.range, 1) + " " + space.unit;
    const Eigen::Vector2d size = Canvas::text_size(label, text, true);
    requests.push_back({size + Eigen::Vector2d(0.9 * text, 0.15 * text), reach});
    named.push_back(&vehicle);
  }
  for (const PlacedVehicle& vehicle : space.truth) {
    layout.avoid.push_back(bounds(footprint(vehicle, map)));
  }
  const std::vector<LabelPlace> places = place_labels(requests, layout);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!places[i].found || !places[i].leader) continue;
    const Eigen::Vector2d from = places[i].box.center();
    const Box2& t = requests[i].target;
    canvas.segments({{from, {std::clamp(from.x(), t.x1, t.x2), std::clamp(from.y(), t.y1, t.y2)}}},
                    1.2 * unit, kInk);
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!places[i].found) continue;
    const Box2& box = places[i].box;
    canvas.rectangle(box, kPaper.with_alpha(0.85), 0.2 * text);
    canvas.rectangle({box.x1, box.y1, box.x1 + 0.25 * text, box.y2}, vehicle_color(*named[i]));
    canvas.text({box.x1 + 0.55 * text, box.center().y()},
                named[i]->name + "  " + format_number(named[i]->range, 1) + " " + space.unit, text,
                kInk, TextAnchor::kLeft, true);
  }
  return image;
}

}  // namespace camber
