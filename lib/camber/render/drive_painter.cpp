#include "camber/render/drive_painter.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <opencv2/imgproc.hpp>
#include <set>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/render/canvas.h"
#include "camber/render/color_map.h"
#include "camber/render/drive_plots.h"
#include "camber/render/picture_file.h"
#include "camber/render/picture_space.h"
#include "camber/render/plot.h"
#include "camber/scene/vehicle_numbers.h"

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kNarrowest = 640, kWidest = 1280;               // pixels of a picture
constexpr double kBehind = 12.0, kAhead = 58.0;               // m around the camera, from above
constexpr double kPatchesBehind = 2.0, kPatchesAhead = 40.0;  // m, of the patches that are drawn
constexpr std::size_t kTrail = 30;  // places of a vehicle's track behind it
constexpr Color kGround{236, 238, 240, 1.0};

/// Encoders see whole blocks: where a side is no multiple, the bytes beside a row decide about its
/// last pixels, and equal pictures give other films.
int whole_blocks(int value) {
  constexpr int kBlock = 32;
  return (value + kBlock - 1) / kBlock * kBlock;
}

int even(double value) { return 2 * std::max(1, static_cast<int>(std::lround(0.5 * value))); }

constexpr int kPlots = 2;            // beside the view from above
constexpr int kLeastPlot = 120;      // px, of a panel
constexpr double kPlotMargin = 0.8;  // of the text's size, about a panel

double least_plot(double text) { return kLeastPlot + kPlotMargin * text; }

/// A frame's camera in plan, strip frame.
struct PlanView {
  Vector2d eye = Vector2d::Zero();
  Vector2d ahead = Vector2d::UnitX();  // unit
  double scale = 1.0;                  // pixels a metre
  Vector2d zero = Vector2d::Zero();    // pixel of the eye

  Vector2d operator()(const Vector3d& p) const {
    const Vector2d off = p.head<2>() - eye;
    const double along = off.dot(ahead), left = ahead.x() * off.y() - ahead.y() * off.x();
    return {zero.x() + scale * along, zero.y() - scale * left};
  }
};

/// Half the pitch of the strip's cells, m.
double half_pitch(const RoadStrip& strip) {
  double pitch = 1e30;
  for (std::size_t i = 1; i < std::min<std::size_t>(strip.cells.size(), 2000); ++i) {
    const double step = std::abs(strip.cells[i].lateral - strip.cells[i - 1].lateral);
    if (step > 1e-6) pitch = std::min(pitch, step);
  }
  return pitch < 1e30 ? 0.5 * pitch : 0.25;
}

}  // namespace

struct DrivePainter::Impl {
  explicit Impl(const DriveContent& c);

  RoadSurface road_near(std::size_t frame) const;
  Image from_above(std::size_t frame) const;
  void draw_strip(cv::Mat& pixels, const PlanView& view, double station) const;
  void draw_line(Canvas& canvas, const PlanView& view, double station) const;
  void draw_vehicles(Canvas& canvas, const PlanView& view, std::size_t frame) const;
  void draw_scale(Canvas& canvas, const PlanView& view) const;
  Image profile_at(std::size_t frame) const;
  std::string caption(std::size_t frame) const;

  const DriveContent& content;
  int overlay_width, width;
  double text;  // pixels
  int overlay_height, panel_height;
  double half_cell;
  std::vector<ProfilePoint> profile;
  std::pair<double, double> grades;
  std::vector<double> stations;
  VehicleNumbers numbers;
  std::map<int, const VehicleFrame*> vehicles;
  std::map<int, std::size_t> index_of;  // of frames, by id
  Image plots;                          // empty: there are none
  std::vector<PlotAxes> axes;
};

DrivePainter::Impl::Impl(const DriveContent& c)
    : content(c),
      overlay_width(std::clamp(c.camera.width, kNarrowest, kWidest)),
      width(whole_blocks(overlay_width)),
      text(std::max(12.0, width / 72.0)),
      overlay_height(std::max(
          1, static_cast<int>(std::lround(c.camera.height *
                                          (static_cast<double>(overlay_width) / c.camera.width))))),
      panel_height(
          whole_blocks(overlay_height + even(std::max(0.28 * width, kPlots * least_plot(text)))) -
          overlay_height),
      half_cell(half_pitch(*c.strip)),
      profile(drive_profile(c)),
      grades(grade_range(profile)),
      stations(frame_stations(c)),
      numbers(*c.vehicles) {
  for (const VehicleFrame& frame : c.vehicles->frames) vehicles[frame.id] = &frame;
  for (std::size_t i = 0; i < c.drive->frames.size(); ++i) index_of[c.drive->frames[i].id] = i;
  try {
    const PlotSheet sheet = drive_film_plots(profile, c.drive->metric);
    PlotStyle style;
    style.width = width - width / 2;
    style.text_size = text;
    const auto panels = static_cast<double>(sheet.panels.size());
    style.panel_height =
        std::max(kLeastPlot, static_cast<int>(panel_height / panels - kPlotMargin * text));
    plots = draw_plots(sheet, style);
    axes = plot_axes(sheet, style);
  } catch (const NoAnswerError&) {
    plots = {};
  }
}

/// The patches around a frame, nearest passes of the line only, and the line through them.
RoadSurface DrivePainter::Impl::road_near(std::size_t frame) const {
  const RoadSurface& all = *content.surface;
  RoadSurface out;
  out.frame = all.frame;
  out.up = all.up;
  out.level = all.level;
  out.metric = all.metric;
  const double station = stations[frame];
  if (!std::isfinite(station)) return out;
  for (std::size_t i = 0; i < all.patches.size() && i < content.stations.size(); ++i) {
    const double ahead = content.stations[i] - station;
    if (ahead > -kPatchesBehind && ahead < kPatchesAhead) out.patches.push_back(all.patches[i]);
  }
  const std::vector<DrivenPoint>& points = content.strip->line.points();
  for (std::size_t i = 0; i < points.size() && i < all.driven_line.size(); ++i) {
    const double ahead = points[i].s - station;
    if (ahead > -kPatchesBehind && ahead < kPatchesAhead) {
      out.driven_line.push_back(all.driven_line[i]);
    }
  }
  return out;
}

void DrivePainter::Impl::draw_strip(cv::Mat& pixels, const PlanView& view, double station) const {
  const std::vector<StripCell>& cells = content.strip->cells;
  auto at = std::lower_bound(cells.begin(), cells.end(), station - kBehind - 10.0,
                             [](const StripCell& cell, double s) { return cell.s < s; });
  double s = std::nan("");
  Vector2d along = Vector2d::Zero(), across = Vector2d::Zero();  // of half a cell, pixels
  for (; at != cells.end() && at->s < station + kAhead + 10.0; ++at) {
    if (at->s != s) {
      s = at->s;
      Vector2d ahead;
      content.strip->line.at(s, &ahead);
      const double a = ahead.dot(view.ahead);
      const double l = view.ahead.x() * ahead.y() - view.ahead.y() * ahead.x();
      along = 1.05 * half_cell * view.scale * Vector2d(a, -l);
      across = 1.05 * half_cell * view.scale * Vector2d(-l, -a);
    }
    const Vector2d middle = view(at->point);
    constexpr int kShift = 4;  // sixteenths of a pixel
    cv::Point corners[4];
    const Vector2d off[4] = {along + across, along - across, -along - across, -along + across};
    for (int i = 0; i < 4; ++i) {
      const Vector2d p = (middle + off[i]) * (1 << kShift);
      corners[i] = {static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y()))};
    }
    cv::fillConvexPoly(pixels, corners, 4, cv::Scalar(at->color[0], at->color[1], at->color[2]),
                       cv::LINE_8, kShift);
  }
}

/// The driven line: solid behind the camera, dashed ahead of it.
void DrivePainter::Impl::draw_line(Canvas& canvas, const PlanView& view, double station) const {
  std::vector<Segment2> behind, ahead;
  const std::vector<DrivenPoint>& points = content.strip->line.points();
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    if (points[i + 1].s < station - kBehind - 10.0 || points[i].s > station + kAhead + 10.0) {
      continue;
    }
    Segment2 piece{view(points[i].foot), view(points[i + 1].foot)};
    (points[i].s < station ? behind : ahead).push_back(piece);
  }
  canvas.segments(behind, 0.16 * text, {0, 114, 178, 1.0});
  canvas.dashed(ahead, 0.5 * text, 0.4 * text, 0.12 * text, {0, 114, 178, 0.9});
}

void DrivePainter::Impl::draw_vehicles(Canvas& canvas, const PlanView& view,
                                       std::size_t frame) const {
  const DriveFrame& now = content.drive->frames[frame];
  const auto found = vehicles.find(now.id);
  const SE3 strip_from_camera = content.strip->strip_from_world * *now.world_from_camera;
  std::set<int> seen;
  if (found != vehicles.end()) {
    for (const VehicleEstimate& v : found->second->vehicles) {
      const int number = numbers.of(now.id, v);
      seen.insert(number);
    }
  }
  for (const DriveTrackLine& track : content.tracks) {
    if (seen.count(track.id) == 0 || track.parked) continue;
    std::vector<Vector2d> trail;
    for (const DriveTrackLine::Place& place : track.places) {
      if (place.frame > now.id) break;
      trail.push_back(view(content.strip->strip_from_world * place.in_world));
    }
    if (trail.size() > kTrail) trail.erase(trail.begin(), trail.end() - kTrail);
    if (trail.size() > 1) {
      canvas.polyline(trail, false, 0.15 * text, categorical(track.id).with_alpha(0.8));
    }
  }
  if (found == vehicles.end()) return;
  for (const VehicleEstimate& v : found->second->vehicles) {
    const auto corners = v.pose.corners();
    if (v.status == Status::kFailed || !corners.allFinite()) continue;
    const int number = numbers.of(now.id, v);
    const Color color = vehicle_color(v.status, number);
    std::vector<Vector2d> footprint;
    for (int i = 0; i < 4; ++i) {
      footprint.push_back(view(strip_from_camera * Vector3d(corners.col(i))));
    }
    canvas.polygon(footprint, color.with_alpha(0.75));
    canvas.polyline(footprint, true, 0.1 * text, kInk);
    const SE3& pose = v.pose.camera_from_vehicle;
    const Vector3d front(0.5 * v.pose.dimensions.length, 0.0, 0.0);
    canvas.segments(
        {{view(strip_from_camera * pose.translation()), view(strip_from_camera * (pose * front))}},
        0.1 * text, kInk);
    canvas.text_with_halo(view(strip_from_camera * pose.translation()), std::to_string(number),
                          text, kInk, kPaper, TextAnchor::kCenter, true);
  }
}

/// Lines across every ten metres with their distances, and the camera.
void DrivePainter::Impl::draw_scale(Canvas& canvas, const PlanView& view) const {
  std::vector<Segment2> lines;
  const double bottom = canvas.height() - 1.0;
  for (double d = -10.0; d < kAhead; d += 10.0) {
    const double x = view.zero.x() + d * view.scale;
    lines.push_back({{x, 0.0}, {x, bottom}});
    if (d <= 0.0) continue;
    canvas.text_with_halo({x, bottom - 0.7 * text},
                          format_number(d, 0) + (content.drive->metric ? " m" : ""), 0.85 * text,
                          kFaintInk, kPaper, TextAnchor::kCenter);
  }
  canvas.segments(lines, 1.0, {120, 126, 134, 0.35});
  const double r = 0.45 * text;
  canvas.polygon({view.zero + Vector2d(1.5 * r, 0.0), view.zero + Vector2d(-r, r),
                  view.zero + Vector2d(-r, -r)},
                 {0, 114, 178, 1.0});
}

Image DrivePainter::Impl::from_above(std::size_t frame) const {
  Image out = make_picture(width / 2, panel_height, kGround.red);
  const DriveFrame& now = content.drive->frames[frame];
  Canvas canvas(out);
  if (now.world_from_camera && std::isfinite(stations[frame])) {
    const SE3 strip_from_camera = content.strip->strip_from_world * *now.world_from_camera;
    PlanView view;
    view.eye = strip_from_camera.translation().head<2>();
    const Vector3d ahead = strip_from_camera.rotation() * Vector3d::UnitZ();
    view.ahead = ahead.head<2>().normalized();
    view.scale = out.width / (kBehind + kAhead);
    view.zero = {kBehind * view.scale, 0.5 * out.height};
    cv::Mat pixels(out.height, out.width, CV_8UC3, out.data.data());
    draw_strip(pixels, view, stations[frame]);
    draw_scale(canvas, view);
    draw_line(canvas, view, stations[frame]);
    draw_vehicles(canvas, view, frame);
  }
  canvas.text_with_halo({0.5 * text, 0.9 * text}, caption(frame), text, kInk, kPaper);
  return out;
}

Image DrivePainter::Impl::profile_at(std::size_t frame) const {
  if (plots.width == 0) return make_picture(width - width / 2, panel_height, 255);
  Image out = plots;
  Canvas canvas(out);
  if (std::isfinite(stations[frame])) {
    for (const PlotAxes& panel : axes) {
      const double x =
          std::clamp(panel.pixel(stations[frame], panel.y_low).x(), panel.box.x1, panel.box.x2);
      canvas.segments({{{x, panel.box.y1}, {x, panel.box.y2}}}, 0.14 * text, {192, 0, 122, 1.0});
    }
  }
  return out;
}

std::string DrivePainter::Impl::caption(std::size_t frame) const {
  const DriveFrame& f = content.drive->frames[frame];
  std::string out = fmt::format("frame {}", f.id);
  if (std::isfinite(f.time_s)) out += fmt::format("  {:.2f} s", f.time_s);
  const char* unit = content.drive->metric ? "m" : "units";
  if (std::isfinite(f.s.value)) out += fmt::format("  {:.1f} {}", f.s.value, unit);
  if (std::isfinite(f.speed.value)) out += fmt::format("  {:.1f} {}/s", f.speed.value, unit);
  if (f.status != Status::kOk) out += "  " + std::string(to_string(f.status));
  return out;
}

DrivePainter::DrivePainter(const DriveContent& content) : impl_(std::make_unique<Impl>(content)) {}
DrivePainter::~DrivePainter() = default;

int DrivePainter::width() const { return impl_->width; }
int DrivePainter::height() const { return impl_->overlay_height + impl_->panel_height; }

Image DrivePainter::overlay(const Image& photo, std::size_t frame, LabelMemory* memory) const {
  const DriveContent& content = impl_->content;
  const DriveFrame& now = content.drive->frames[frame];
  OverlayOptions options;
  options.upscale = static_cast<double>(impl_->overlay_width) / content.camera.width;
  options.metric = content.drive->metric;
  options.show_boxes_2d = false;
  options.show_planes = false;
  options.grade_range = impl_->grades;
  options.label_memory = memory;
  options.numbers = impl_->numbers;
  VehicleFrame none;
  none.id = now.id;
  const auto found = impl_->vehicles.find(now.id);
  const RoadSurface road = impl_->road_near(frame);
  OverlayRoad shown;
  if (now.world_from_camera && !road.patches.empty()) {
    shown.surface = &road;
    shown.reference_from_camera = *now.world_from_camera;
    options.show_patches = options.show_grade = true;
  }
  return draw_overlay(photo, content.camera, found == impl_->vehicles.end() ? none : *found->second,
                      options, shown);
}

Image DrivePainter::picture(const Image& overlay, std::size_t frame) const {
  Image out = make_picture(width(), height(), 255);
  const cv::Mat pixels(out.height, out.width, CV_8UC3, out.data.data());
  const auto put = [&](const Image& part, int x, int y) {
    const int w = std::min(part.width, out.width - x), h = std::min(part.height, out.height - y);
    if (w <= 0 || h <= 0) return;
    const cv::Mat from(part.height, part.width, CV_8UC3,
                       const_cast<std::uint8_t*>(part.data.data()));
    from(cv::Rect(0, 0, w, h)).copyTo(pixels(cv::Rect(x, y, w, h)));
  };
  put(overlay, (out.width - overlay.width) / 2, 0);
  put(impl_->from_above(frame), 0, impl_->overlay_height);
  put(impl_->profile_at(frame), width() / 2, impl_->overlay_height);
  return out;
}

}  // namespace camber
