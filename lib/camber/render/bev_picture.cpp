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

/// The position's ellipse of one standard deviation; empty where no covariance is stated, or one
/// that reaches as far as the camera and shows nothing.
/// @param least  pixels; a radius is drawn no smaller, so that a narrow ellipse is no bare line
std::vector<Eigen::Vector2d> ellipse(const PlacedVehicle& vehicle, const Map& map, double least) {
  const Eigen::Matrix2d covariance = vehicle.center_covariance.topLeftCorner<2, 2>();
  if (!covariance.allFinite() || !(covariance.trace() > 0.0)) return {};
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(
      0.5 * (covariance + covariance.transpose()));
  if (solver.info() != Eigen::Success) return {};
  Eigen::Vector2d axes = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  if (!(axes.maxCoeff() < std::max(vehicle.range, 1e-9))) return {};
  axes = axes.cwiseMax(least / map.scale);
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

/// One picture being drawn.
class BevPainter {
 public:
  BevPainter(const PictureContent& content, const BevPictureOptions& options)
      : content_(content),
        options_(options),
        space_(make_picture_space(content, options.show_truth, options.color)),
        summary_(content_summary(content, space_)),
        unit_(std::max(0.5, std::min(options.width / 1600.0, options.height / 900.0))),
        text_(20.0 * unit_),
        thin_(std::max(1.0, unit_)),
        image_(make_picture(options.width, options.height, 255)),
        canvas_(image_) {
    hide_what_is_not_shown();
    links_shown_ = options_.show_links && !space_.links.empty();
    make_entries();
    place_frame();
  }

  Image draw() {
    draw_points();
    draw_field_of_view();
    draw_patches();
    draw_vehicles();
    draw_path();
    draw_axes();
    draw_margins();
    draw_labels(draw_scale_bar());
    return std::move(image_);
  }

 private:
  void hide_what_is_not_shown();
  void make_entries();
  void place_frame();
  void draw_points();
  void draw_field_of_view();
  void draw_patches();
  void draw_vehicles();
  void draw_path();
  void draw_axes();
  void draw_margins();
  Box2 draw_scale_bar();
  void draw_labels(const Box2& plate);

  std::string label_of(const PlacedVehicle& vehicle) const {
    return vehicle.name + "  " + range_text(vehicle, space_.unit, options_.show_ellipses);
  }
  double column(double value) const { return map_.zero.x() + map_.scale * value; }
  double row(double value) const { return map_.zero.y() + down_sign_ * map_.scale * value; }

  const PictureContent& content_;
  const BevPictureOptions& options_;
  PictureSpace space_;
  std::string summary_;        // of all content, shown or not
  double unit_, text_, thin_;  // pixels: of sizes, of letters, of thin lines
  Image image_;
  Canvas canvas_;
  bool links_shown_ = false;
  std::vector<LegendEntry> legend_;
  double legend_top_ = 0.0;  // pixel
  Box2 frame_;               // of the plot
  Map map_;
  double down_sign_ = 1.0;  // of what runs along the picture's rows
  double step_ = 1.0;       // of the grid
  Ticks column_ticks_, row_ticks_;
  std::vector<Segment2> grid_;
};

/// What is not shown is taken out; the frame stays.
void BevPainter::hide_what_is_not_shown() {
  if (!options_.show_points) {
    space_.points.clear();
    space_.colors.clear();
    space_.has_color_bar = false;
    space_.classes.clear();
  }
  if (!options_.show_truth_cloud) space_.truth_points.clear();
  if (!options_.show_patches) space_.patches.clear();
  if (!options_.show_vehicles) space_.vehicles.clear();
  if (!options_.show_cameras) {
    space_.cameras.clear();
    space_.current_camera = -1;
  }
}

void BevPainter::make_entries() {
  legend_ = make_legend(space_, "camera path");
  using Mark = LegendEntry::Mark;
  const bool any_ellipse =
      options_.show_ellipses &&
      std::any_of(space_.vehicles.begin(), space_.vehicles.end(), [](const PlacedVehicle& vehicle) {
        return !ellipse(vehicle, Map(), 0.0).empty();
      });
  if (any_ellipse) legend_.push_back({Mark::kEllipse, kInk, "its position, ± 1 sigma"});
  if (content_.camera && space_.current_camera >= 0) {
    legend_.push_back({Mark::kDashedLine, kInk, "field of view"});
  }
  for (const bool valid : {true, false}) {
    const bool any =
        links_shown_ && std::any_of(space_.links.begin(), space_.links.end(),
                                    [&](const PlacedLink& link) { return link.valid == valid; });
    if (any && valid) legend_.push_back({Mark::kLine, plasma(0.3), "link of patches"});
    if (any && !valid) legend_.push_back({Mark::kDashedLine, kInk, "link not used"});
  }
  legend_top_ =
      options_.height - 0.6 * text_ -
      legend_height(count_legend_rows(options_.width - 2.0 * text_, legend_, text_), text_);
}

/// The plot's frame, a map that fits the content into it without distortion, and the grid.
void BevPainter::place_frame() {
  const double top = content_.title.empty() ? 2.2 * text_ : 3.8 * text_;
  const bool bars = space_.has_color_bar || links_shown_;
  const auto digits = [&](double value) {
    return Canvas::text_size(format_number(value, 0), text_).x();
  };
  // Whole coordinates of a map are long.
  const double widest = std::max(digits(space_.origin.y() + space_.ahead.low),
                                 digits(space_.origin.y() + space_.ahead.high));
  frame_ = {std::max(4.4 * text_, widest + 2.6 * text_), top,
            options_.width - (bars ? 10.5 : 1.5) * text_, legend_top_ - 3.3 * text_};
  const double pad = 1.2 * text_;
  map_.north_up = space_.map;
  // What runs along the picture's columns and rows.
  const RobustRange& across = space_.map ? space_.right : space_.ahead;
  const RobustRange& down = space_.map ? space_.ahead : space_.right;
  down_sign_ = space_.map ? -1.0 : 1.0;
  map_.scale = std::min((frame_.width() - 2.0 * pad) / std::max(across.span(), 1e-3),
                        (frame_.height() - 2.0 * pad) / std::max(down.span(), 1e-3));
  map_.scale = std::max(map_.scale, 1e-6);
  map_.zero = {frame_.center().x() - map_.scale * 0.5 * (across.low + across.high),
               frame_.center().y() - down_sign_ * map_.scale * 0.5 * (down.low + down.high)};
  const RobustRange shown_across{(frame_.x1 - map_.zero.x()) / map_.scale,
                                 (frame_.x2 - map_.zero.x()) / map_.scale};
  const double edge1 = down_sign_ * (frame_.y1 - map_.zero.y()) / map_.scale;
  const double edge2 = down_sign_ * (frame_.y2 - map_.zero.y()) / map_.scale;
  // One grid spacing for both axes, so that the grid's cells are squares.
  step_ = make_ticks(
              shown_across.low, shown_across.high,
              std::max(2, static_cast<int>(frame_.width() /
                                           std::max(5.0 * text_, 2.0 * digits(space_.origin.x())))))
              .step;
  column_ticks_ = multiples_of(step_, shown_across.low, shown_across.high,
                               space_.map ? space_.origin.x() : 0.0);
  row_ticks_ = multiples_of(step_, std::min(edge1, edge2), std::max(edge1, edge2),
                            space_.map ? space_.origin.y() : 0.0);
  for (const double at : column_ticks_.values) {
    const double x = column(at);
    grid_.push_back({{x, frame_.y1}, {x, frame_.y2}});
  }
  for (const double at : row_ticks_.values) {
    const double y = row(at);
    grid_.push_back({{frame_.x1, y}, {frame_.x2, y}});
  }
}

void BevPainter::draw_points() {
  canvas_.segments(grid_, thin_, {222, 225, 229, 1.0});

  if (!space_.truth_points.empty()) {
    PictureSpace truth;
    truth.points = space_.truth_points;
    truth.colors.assign(truth.points.size(), {kTruthGrey.red, kTruthGrey.green, kTruthGrey.blue});
    splat_points(image_, truth, map_, frame_, 1.4 * unit_);
  }
  if (!space_.points.empty()) {
    double size = options_.point_size;
    if (size <= 0.0) {
      const double area = std::max(1e-6, space_.right.span() * space_.ahead.span());
      const double spacing = std::sqrt(area / static_cast<double>(space_.points.size()));
      size = std::clamp(0.7 * spacing * map_.scale / unit_, 1.4, 3.0) * unit_;
    }
    splat_points(image_, space_, map_, frame_, size);
    canvas_.segments(grid_, thin_, {255, 255, 255, 0.25});
  }
}

/// The camera's field of view: its image's left and right edges.
void BevPainter::draw_field_of_view() {
  if (content_.camera && space_.current_camera >= 0) {
    const SE3& camera = space_.cameras[static_cast<std::size_t>(space_.current_camera)];
    const double far = 3.0 * (space_.ahead.span() + space_.right.span() + 10.0);
    std::vector<Segment2> edges;
    for (const double u : {-0.5, content_.camera->width - 0.5}) {
      const Eigen::Vector3d ray = content_.camera->ray({u, content_.camera->cy}) * far;
      Segment2 edge{map_(camera.translation()), map_(camera * ray)};
      if (clip_segment(frame_, &edge.first, &edge.second)) edges.push_back(edge);
    }
    canvas_.dashed(edges, 0.5 * text_, 0.3 * text_, 1.2 * unit_, kInk.with_alpha(0.7));
  }
}

/// Patches and their links.
void BevPainter::draw_patches() {
  for (const PlacedPatch& patch : space_.patches) {
    std::vector<Eigen::Vector2d> rim;
    for (const Eigen::Vector3d& corner : patch.boundary) rim.push_back(map_(corner));
    canvas_.polygon(rim, kPaper.with_alpha(0.25));
    canvas_.polyline(rim, true, 3.4 * unit_, kPaper.with_alpha(0.8));
    canvas_.polyline(rim, true, 2.0 * unit_, patch_color(patch.kind));
  }
  if (links_shown_) {
    std::vector<Segment2> invalid;
    for (const PlacedLink& link : space_.links) {
      const Segment2 line{map_(link.a), map_(link.b)};
      if (!link.valid) {
        invalid.push_back(line);
        continue;
      }
      canvas_.segments({line}, 5.0 * unit_, kPaper.with_alpha(0.8));
      canvas_.segments({line}, 3.0 * unit_, link_color(link, space_));
    }
    canvas_.dashed(invalid, 0.4 * text_, 0.3 * text_, 1.6 * unit_, kInk);
  }
}

void BevPainter::draw_vehicles() {
  for (const PlacedVehicle& vehicle : space_.vehicles) {
    const Color color = vehicle_color(vehicle);
    const std::vector<Eigen::Vector2d> rim = footprint(vehicle, map_);
    canvas_.polygon(rim, color.with_alpha(0.8));
    canvas_.polyline(rim, true, 2.0 * unit_, darker(color, 0.45));
    canvas_.segments({heading(vehicle, map_)}, 2.0 * unit_, darker(color, 0.45));
  }
  for (const PlacedVehicle& vehicle : space_.truth) {
    canvas_.polyline(footprint(vehicle, map_), true, 2.0 * unit_, kTruthRed);
    canvas_.segments({heading(vehicle, map_)}, 2.0 * unit_, kTruthRed);
  }
  if (!options_.show_ellipses) return;
  for (const PlacedVehicle& vehicle : space_.vehicles) {
    const std::vector<Eigen::Vector2d> region = ellipse(vehicle, map_, 3.0 * unit_);
    if (region.empty()) continue;
    canvas_.polygon(region, kPaper.with_alpha(0.85));
    canvas_.polyline(region, true, 1.6 * unit_, kInk);
  }
}

void BevPainter::draw_path() {
  std::vector<Eigen::Vector2d> path;
  for (const SE3& camera : space_.cameras) path.push_back(map_(camera.translation()));
  canvas_.polyline(path, false, 3.0 * unit_, kInk);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const bool current = static_cast<int>(i) == space_.current_camera;
    canvas_.disc(path[i], (current ? 6.0 : 3.5) * unit_, kInk);
    if (current) canvas_.disc(path[i], 3.0 * unit_, kPaper);
  }
}

/// The frame and its ticks; what reaches outside of it is wiped.
void BevPainter::draw_axes() {
  const double w = options_.width, h = options_.height;
  for (const Box2& outside : {Box2{-1, -1, w, frame_.y1}, Box2{-1, frame_.y2, w, h},
                              Box2{-1, -1, frame_.x1, h}, Box2{frame_.x2, -1, w, h}}) {
    canvas_.rectangle(outside, kPaper);
  }
  canvas_.polyline({{frame_.x1, frame_.y1},
                    {frame_.x2, frame_.y1},
                    {frame_.x2, frame_.y2},
                    {frame_.x1, frame_.y2}},
                   true, thin_, kFaintInk);
  for (std::size_t i = 0; i < column_ticks_.values.size(); ++i) {
    const double x = column(column_ticks_.values[i]);
    canvas_.segments({{{x, frame_.y2}, {x, frame_.y2 + 0.3 * text_}}}, thin_, kInk);
    canvas_.text({x, frame_.y2 + 0.95 * text_}, column_ticks_.labels[i], text_, kInk,
                 TextAnchor::kCenter);
  }
  for (std::size_t i = 0; i < row_ticks_.values.size(); ++i) {
    const double y = row(row_ticks_.values[i]);
    canvas_.segments({{{frame_.x1 - 0.3 * text_, y}, {frame_.x1, y}}}, thin_, kInk);
    canvas_.text({frame_.x1 - 0.5 * text_, y}, row_ticks_.labels[i], text_, kInk,
                 TextAnchor::kRight);
  }
  canvas_.text({frame_.center().x(), frame_.y2 + 2.1 * text_},
               (space_.map ? space_.right_name : space_.ahead_name) + " (" + space_.unit + ")",
               text_, kInk, TextAnchor::kCenter);
  canvas_.text_upwards(
      {1.2 * text_, frame_.center().y()},
      (space_.map ? space_.ahead_name : "left  -  " + space_.right_name) + " (" + space_.unit + ")",
      text_, kInk);
}

/// Title, summary, colour bars and legend.
void BevPainter::draw_margins() {
  double line = 1.1 * text_;
  if (!content_.title.empty()) {
    canvas_.text({text_, line}, content_.title, 1.25 * text_, kInk, TextAnchor::kLeft, true);
    line += 1.5 * text_;
  }
  canvas_.text({text_, line}, summary_, text_, kFaintInk);
  const double bar_left = options_.width - 9.2 * text_;
  if (space_.has_color_bar) {
    const double bar_top = frame_.y1 + 1.2 * text_ * static_cast<double>(space_.color_title.size());
    const double bar_bottom = links_shown_ ? frame_.center().y() - 0.4 * text_ : frame_.y2;
    draw_color_bar(canvas_, {bar_left, bar_top, bar_left + 1.2 * text_, bar_bottom},
                   space_.color_range.low, space_.color_range.high, space_.color_title, text_, kInk,
                   space_.color_scale);
  }
  if (links_shown_) {
    const double start = space_.has_color_bar ? frame_.center().y() + 0.4 * text_ : frame_.y1;
    draw_color_bar(canvas_, {bar_left, start + 2.4 * text_, bar_left + 1.2 * text_, frame_.y2}, 0.0,
                   space_.link_steps.high, {"height step", "of a link (" + space_.unit + ")"},
                   text_, kInk, plasma);
  }
  draw_legend(canvas_, {text_, legend_top_ + 0.65 * text_}, options_.width - text_, legend_, text_);
}

/// A bar as long as a cell of the grid. @return the plate that it stands on, pixels
Box2 BevPainter::draw_scale_bar() {
  const Eigen::Vector2d bar_end(frame_.x2 - 0.8 * text_, frame_.y2 - 0.9 * text_);
  const Eigen::Vector2d bar_start = bar_end - Eigen::Vector2d(map_.scale * step_, 0.0);
  const std::string bar_text = format_step(step_) + " " + space_.unit;
  const double bar_text_width = Canvas::text_size(bar_text, text_, true).x();
  const double plate_left =
      std::min(bar_start.x(), 0.5 * (bar_start.x() + bar_end.x()) - 0.5 * bar_text_width);
  const Box2 plate{plate_left - 0.5 * text_, bar_end.y() - 1.9 * text_, frame_.x2 - 0.3 * text_,
                   frame_.y2 - 0.3 * text_};
  canvas_.rectangle(plate, kPaper.with_alpha(0.85), 0.2 * text_);
  canvas_.segments(
      {{bar_start, bar_end},
       {bar_start - Eigen::Vector2d(0, 0.3 * text_), bar_start + Eigen::Vector2d(0, 0.3 * text_)},
       {bar_end - Eigen::Vector2d(0, 0.3 * text_), bar_end + Eigen::Vector2d(0, 0.3 * text_)}},
      2.0 * unit_, kInk);
  canvas_.text({0.5 * (bar_start.x() + bar_end.x()), bar_end.y() - 1.0 * text_}, bar_text, text_,
               kInk, TextAnchor::kCenter, true);
  return plate;
}

/// Labels last: they cover what they must. @param plate  to be left free
void BevPainter::draw_labels(const Box2& plate) {
  std::vector<LabelRequest> requests;
  std::vector<const PlacedVehicle*> named;
  LabelLayoutOptions layout;
  layout.area = frame_.grown(-2.0);
  layout.gap = 0.25 * text_;
  layout.taken = {plate};
  for (const PlacedVehicle& vehicle : space_.vehicles) {
    const Box2 reach = bounds(footprint(vehicle, map_));
    layout.avoid.push_back(reach);
    if (!frame_.contains(reach.center())) continue;
    const std::string label = label_of(vehicle);
    const Eigen::Vector2d size = Canvas::text_size(label, text_, true);
    requests.push_back({size + Eigen::Vector2d(0.9 * text_, 0.15 * text_), reach});
    named.push_back(&vehicle);
  }
  for (const PlacedVehicle& vehicle : space_.truth) {
    layout.avoid.push_back(bounds(footprint(vehicle, map_)));
  }
  const std::vector<LabelPlace> places = place_labels(requests, layout);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!places[i].found || !places[i].leader) continue;
    const Eigen::Vector2d from = places[i].box.center();
    const Box2& t = requests[i].target;
    canvas_.segments({{from, {std::clamp(from.x(), t.x1, t.x2), std::clamp(from.y(), t.y1, t.y2)}}},
                     1.2 * unit_, kInk);
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!places[i].found) continue;
    const Box2& box = places[i].box;
    canvas_.rectangle(box, kPaper.with_alpha(0.85), 0.2 * text_);
    canvas_.rectangle({box.x1, box.y1, box.x1 + 0.25 * text_, box.y2}, vehicle_color(*named[i]));
    canvas_.text({box.x1 + 0.55 * text_, box.center().y()}, label_of(*named[i]), text_, kInk,
                 TextAnchor::kLeft, true);
  }
}

}  // namespace

void BevPictureOptions::validate() const {
  check_picture_option("width", width, 64, 8192);
  check_picture_option("height", height, 64, 8192);
  check_picture_option("point_size", point_size, 0.0, 20.0);
}

Image render_bev_picture(const PictureContent& content, const BevPictureOptions& options) {
  options.validate();
  return BevPainter(content, options).draw();
}

}  // namespace camber
