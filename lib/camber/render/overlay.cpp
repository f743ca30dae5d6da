#include "camber/render/overlay.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "camber/render/canvas.h"
#include "camber/render/color_map.h"
#include "camber/render/detail/road_grid.h"
#include "camber/render/label_layout.h"
#include "camber/render/picture_file.h"
#include "camber/render/wireframe.h"

namespace camber {
namespace {

constexpr double kNear = 0.2;  // m, drawing starts here before the camera

const Color kDark{16, 18, 22, 1.0};
const Color kUntrusted{190, 190, 190, 1.0};

void check_range(const char* name, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw std::invalid_argument("overlay option " + std::string(name) + ": found " +
                                std::to_string(value) + ", expected " + std::to_string(low) +
                                " to " + std::to_string(high));
  }
}

Color brighter(const Color& color) {
  const auto mix = [](int c) { return static_cast<std::uint8_t>(c + (255 - c) / 4); };
  return {mix(color.red), mix(color.green), mix(color.blue), color.alpha};
}

/// Projects the part of a 3D segment that lies before the camera.
bool project_segment(const PinholeCamera& camera, Eigen::Vector3d a, Eigen::Vector3d b,
                     Segment2* out) {
  if (!a.allFinite() || !b.allFinite()) return false;
  if (a.z() < kNear && b.z() < kNear) return false;
  if (a.z() < kNear) a += (b - a) * ((kNear - a.z()) / (b.z() - a.z()));
  if (b.z() < kNear) b += (a - b) * ((kNear - b.z()) / (a.z() - b.z()));
  *out = {*camera.project(a), *camera.project(b)};
  return true;
}

/// Cuts 3D segments into pieces and sorts them by whether a body hides their middles.
struct SplitLines {
  std::vector<Segment2> visible, hidden;

  void add(const PinholeCamera& camera, const Occluders& occluders, const Eigen::Vector3d& a,
           const Eigen::Vector3d& b, int pieces, double tolerance) {
    bool last_hidden = false;
    for (int i = 0; i < pieces; ++i) {
      const Eigen::Vector3d from = a + (b - a) * (static_cast<double>(i) / pieces);
      const Eigen::Vector3d to = a + (b - a) * (static_cast<double>(i + 1) / pieces);
      Segment2 line;
      if (!project_segment(camera, from, to, &line)) continue;
      const bool hide = occluders.hides(0.5 * (from + to), tolerance);
      auto& list = hide ? hidden : visible;
      // Pieces in a row become one line, so that joints do not show.
      if (i > 0 && hide == last_hidden && !list.empty() && list.back().second == line.first) {
        list.back().second = line.second;
      } else {
        list.push_back(line);
      }
      last_hidden = hide;
    }
  }
};

struct Drawn {
  const VehicleEstimate* vehicle = nullptr;
  int number = 0;  // VehicleNumbers
  bool box = false, wireframe = false;
  double range = 0.0;         // m
  double pixel_height = 0.0;  // of the drawing
  Color color;
  Box2 reach;  // pixels that the drawing covers
};

Box2 united(const Box2& a, const Eigen::Vector2d& p) {
  return {std::min(a.x1, p.x()), std::min(a.y1, p.y()), std::max(a.x2, p.x()),
          std::max(a.y2, p.y())};
}

/// The plane under a vehicle: lines every metre, from one metre outside the footprint.
void draw_plane_grid(Canvas& canvas, const PinholeCamera& camera, const Occluders& occluders,
                     const Drawn& drawn, double unit) {
  const VehicleEstimate& v = *drawn.vehicle;
  const Eigen::Vector3d n = v.plane.normal;
  if (!n.allFinite() || std::abs(n.norm() - 1.0) > 1e-3 || !std::isfinite(v.plane.offset)) return;
  const Eigen::Vector3d front = v.pose.camera_from_vehicle.rotation_matrix().col(0);
  Eigen::Vector3d along = front - n * n.dot(front);
  if (along.norm() < 1e-6) return;
  along.normalize();
  const Eigen::Vector3d across = along.cross(n);
  const Eigen::Vector3d origin = v.plane.foot(v.pose.bottom_center());
  const double half_length = std::ceil(0.5 * v.pose.dimensions.length + 0.7);
  const double half_width = std::ceil(0.5 * v.pose.dimensions.width + 0.7);
  SplitLines inner, rim;
  const auto add = [&](SplitLines& lines, double l1, double w1, double l2, double w2) {
    const int pieces = std::max(4, static_cast<int>(std::hypot(l2 - l1, w2 - w1) * 4.0));
    lines.add(camera, occluders, origin + l1 * along + w1 * across,
              origin + l2 * along + w2 * across, pieces, 0.02);
  };
  for (double l = -half_length; l <= half_length + 1e-9; l += 1.0) {
    add(std::abs(l) > half_length - 1e-6 ? rim : inner, l, -half_width, l, half_width);
  }
  for (double w = -half_width; w <= half_width + 1e-9; w += 1.0) {
    add(std::abs(w) > half_width - 1e-6 ? rim : inner, -half_length, w, half_length, w);
  }
  const double size = std::clamp(drawn.pixel_height / (60.0 * unit), 0.45, 1.0);
  canvas.segments(inner.visible, 1.0 * unit * size, drawn.color.with_alpha(0.45));
  canvas.segments(rim.visible, 1.4 * unit * size, drawn.color.with_alpha(0.8));
}

void draw_wireframe(Canvas& canvas, const PinholeCamera& camera, const Occluders& occluders,
                    const Drawn& drawn, double unit) {
  const VehicleEstimate& v = *drawn.vehicle;
  SplitLines lines;
  constexpr int kPieces = 8;
  constexpr double kTolerance = 0.06;  // m; an edge does not hide itself
  for (const auto& [a, b] : wireframe_edges()) {
    lines.add(camera, occluders, v.keypoints[a], v.keypoints[b], kPieces, kTolerance);
  }
  // Wheels: circles about their centres that touch the ground.
  SplitLines wheels;
  const Eigen::Matrix3d r = v.pose.camera_from_vehicle.rotation_matrix();
  for (const int wheel : {0, 1, 18, 19}) {
    const Eigen::Vector3d& center = v.keypoints[wheel];
    const double radius = std::abs(r.col(1).dot(center - v.pose.bottom_center()));
    if (!(radius > 0.15 && radius < 0.7)) continue;
    constexpr int kSteps = 24;
    const auto rim = [&](int step) {
      const double angle = 2.0 * M_PI * step / kSteps;
      return Eigen::Vector3d(center +
                             radius * (std::cos(angle) * r.col(0) + std::sin(angle) * r.col(1)));
    };
    for (int step = 0; step < kSteps; ++step) {
      wheels.add(camera, occluders, rim(step), rim(step + 1), 1, 0.10);
    }
  }
  const double size = std::clamp(drawn.pixel_height / (70.0 * unit), 0.4, 1.0);
  const double thin = 0.8 * unit * size, solid = 2.0 * unit * size;
  canvas.segments(lines.hidden, thin, drawn.color.with_alpha(0.45));
  std::vector<Segment2> visible = lines.visible;
  canvas.segments(visible, solid + 1.6 * unit * size, kDark.with_alpha(0.55));
  canvas.segments(wheels.visible, std::max(1.0, 0.6 * solid), drawn.color.with_alpha(0.9));
  canvas.segments(visible, solid, drawn.color);
}

void draw_box_3d(Canvas& canvas, const PinholeCamera& camera, const Occluders& occluders,
                 const Drawn& drawn, double unit) {
  const auto corners = drawn.vehicle->pose.corners();
  SplitLines lines;
  for (const auto& [a, b] : box_edges()) {
    lines.add(camera, occluders, corners.col(a), corners.col(b), 16, 0.02);
  }
  const double size = std::clamp(drawn.pixel_height / (60.0 * unit), 0.5, 1.0);
  canvas.segments(lines.hidden, 0.6 * unit * size, Color{255, 255, 255, 0.25});
  canvas.segments(lines.visible, 0.9 * unit * size, Color{255, 255, 255, 0.75});
}

/// The part of a polygon before the camera, in pixels.
std::vector<Eigen::Vector2d> project_polygon(const PinholeCamera& camera,
                                             const std::vector<Eigen::Vector3d>& corners) {
  std::vector<Eigen::Vector2d> out;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector3d& a = corners[i];
    const Eigen::Vector3d& b = corners[(i + 1) % corners.size()];
    if (!a.allFinite() || !b.allFinite()) return {};
    if (a.z() >= kNear) out.push_back(*camera.project(a));
    if ((a.z() < kNear) != (b.z() < kNear)) {
      Eigen::Vector3d cut = a + (b - a) * ((kNear - a.z()) / (b.z() - a.z()));
      cut.z() = kNear;
      out.push_back(*camera.project(cut));
    }
  }
  if (out.size() < 3) out.clear();
  return out;
}

/// The image as it was on the pixels that vehicles cover: a road is painted behind them.
void restore_vehicles(cv::Mat& image, const cv::Mat& before, const PinholeCamera& camera,
                      const std::vector<Drawn>& all) {
  cv::Mat covered = cv::Mat::zeros(image.rows, image.cols, CV_8U);
  for (const Drawn& drawn : all) {
    if (!drawn.wireframe) continue;
    for (const auto& t : wireframe_triangles()) {
      const auto& x = drawn.vehicle->keypoints;
      const std::vector<Eigen::Vector2d> corners =
          project_polygon(camera, {x[t[0]], x[t[1]], x[t[2]]});
      std::vector<cv::Point> pixels;
      for (const Eigen::Vector2d& c : corners) {
        pixels.emplace_back(static_cast<int>(std::lround(std::clamp(c.x(), -1e4, 1e4))),
                            static_cast<int>(std::lround(std::clamp(c.y(), -1e4, 1e4))));
      }
      if (pixels.size() >= 3) cv::fillConvexPoly(covered, pixels, cv::Scalar(255));
    }
  }
  before.copyTo(image, covered);
}

/// A plate with a colour bar lying along the lower left corner; returns what it covers.
Box2 draw_grade_bar(Canvas& canvas, double low, double high, double unit) {
  const double size = 16.0 * unit;
  const Box2 plate{8.0 * unit, canvas.height() - 1.0 - 8.0 * unit - 3.6 * size,
                   8.0 * unit + 13.0 * size, canvas.height() - 1.0 - 8.0 * unit};
  canvas.rectangle(plate, kDark.with_alpha(0.8), 0.3 * size);
  const Color white{255, 255, 255, 1.0};
  canvas.text({plate.x1 + 0.7 * size, plate.y1 + 0.75 * size}, "grade along the road (deg)", size,
              white);
  const Box2 bar{plate.x1 + 1.2 * size, plate.y1 + 1.45 * size, plate.x2 - 1.2 * size,
                 plate.y1 + 2.15 * size};
  const int columns = std::max(1, static_cast<int>(bar.width()));
  for (int i = 0; i < columns; ++i) {
    const double x = bar.x1 + i;
    canvas.segments({{{x, bar.y1}, {x, bar.y2}}}, 1.0, viridis((i + 0.5) / columns));
  }
  const Ticks ticks = make_ticks(low, high, 4);
  for (std::size_t i = 0; i < ticks.values.size(); ++i) {
    const double x = bar.x1 + bar.width() * (ticks.values[i] - low) / (high - low);
    canvas.segments({{{x, bar.y2}, {x, bar.y2 + 0.25 * size}}}, 1.0, white);
    canvas.text({x, bar.y2 + 0.8 * size}, ticks.labels[i], size, white, TextAnchor::kCenter);
  }
  return plate;
}

/// The road's grid with its numbers; adds what these cover.
void draw_grid(Canvas& canvas, const PinholeCamera& camera, const Occluders& occluders,
               const RoadGrid& grid, bool metric, double unit, std::vector<Box2>* taken) {
  const Color white{255, 255, 255, 1.0};
  const auto lines_of = [&](const std::vector<RoadGrid::Line>& from) {
    SplitLines lines;
    for (const auto& [a, b] : from) {
      lines.add(camera, occluders, a, b, std::clamp(static_cast<int>((b - a).norm() * 2.0), 2, 64),
                0.02);
    }
    return lines.visible;
  };
  canvas.segments(lines_of(grid.fine), 0.9 * unit, white.with_alpha(0.4));
  canvas.segments(lines_of(grid.coarse), 2.0 * unit, white.with_alpha(0.9));
  const double size = 16.0 * unit;
  for (const auto& [distance, end] : grid.labels) {
    const auto pixel = end.z() > kNear ? camera.project(end) : std::nullopt;
    if (!pixel) continue;
    const std::string text = std::to_string(distance) + (metric ? " m" : "");
    const Eigen::Vector2d extent = Canvas::text_size(text, size, true);
    const Box2 plate{pixel->x() + 0.4 * size, pixel->y() - 0.6 * extent.y(),
                     pixel->x() + 0.8 * size + extent.x(), pixel->y() + 0.6 * extent.y()};
    const bool inside = plate.x1 >= 0.0 && plate.y1 >= 0.0 && plate.x2 < canvas.width() &&
                        plate.y2 < canvas.height();
    const bool free = std::none_of(taken->begin(), taken->end(), [&](const Box2& other) {
      return plate.x1 < other.x2 && other.x1 < plate.x2 && plate.y1 < other.y2 &&
             other.y1 < plate.y2;
    });
    if (!inside || !free) continue;
    canvas.rectangle(plate, kDark.with_alpha(0.7), 0.2 * size);
    canvas.text({plate.x1 + 0.2 * size, plate.center().y()}, text, size, white, TextAnchor::kLeft,
                true);
    taken->push_back(plate);
  }
}

/// Tints the pixels that a mask, enlarged to the image, marks.
void tint_mask(cv::Mat& pixels, const Image& mask) {
  const cv::Mat small(mask.height, mask.width, CV_8U, const_cast<std::uint8_t*>(mask.data.data()));
  cv::Mat large;
  cv::resize(small, large, pixels.size(), 0, 0, cv::INTER_NEAREST);
  cv::Mat tinted;
  cv::addWeighted(pixels, 0.65, cv::Mat(pixels.size(), CV_8UC3, cv::Scalar(40, 120, 255)), 0.35,
                  0.0, tinted);
  tinted.copyTo(pixels, large != 0);
}

/// A patch in the camera's frame.
struct DrawnPatch {
  const PlanePatch* patch;
  std::vector<Eigen::Vector3d> rim;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
};

/// The patches that lie before the camera, farthest first.
std::vector<DrawnPatch> drawn_patches(const RoadSurface& surface, const PinholeCamera& camera,
                                      const SE3& camera_from_reference) {
  std::vector<DrawnPatch> out;
  for (const PlanePatch& patch : surface.patches) {
    DrawnPatch p{&patch, {}};
    for (const Eigen::Vector3d& corner : patch.boundary) {
      p.rim.push_back(camera_from_reference * corner);
      p.middle += p.rim.back() / static_cast<double>(patch.boundary.size());
    }
    if (p.rim.size() < 3 || !p.middle.allFinite()) continue;
    if (project_polygon(camera, p.rim).empty()) continue;
    out.push_back(std::move(p));
  }
  std::stable_sort(out.begin(), out.end(), [](const DrawnPatch& a, const DrawnPatch& b) {
    return a.middle.squaredNorm() > b.middle.squaredNorm();
  });
  return out;
}

struct GradeRange {
  double low = 1e9, high = -1e9;  // degrees
};

GradeRange grade_range(const std::vector<DrawnPatch>& patches) {
  GradeRange out;
  for (const DrawnPatch& p : patches) {
    out.low = std::min(out.low, p.patch->grade * 180.0 / M_PI);
    out.high = std::max(out.high, p.patch->grade * 180.0 / M_PI);
  }
  if (!(out.high - out.low > 0.2)) {
    out.low -= 0.5;
    out.high += 0.5;
  }
  return out;
}

void draw_outline(Canvas& canvas, const PinholeCamera& camera, const Occluders& occluders,
                  const DrawnPatch& p, const Color& ink, double unit) {
  SplitLines rim;
  for (std::size_t i = 0; i < p.rim.size(); ++i) {
    const Eigen::Vector3d& a = p.rim[i];
    const Eigen::Vector3d& b = p.rim[(i + 1) % p.rim.size()];
    rim.add(camera, occluders, a, b, std::clamp(static_cast<int>((b - a).norm() * 2.0), 2, 64),
            0.02);
  }
  canvas.segments(rim.visible, 3.0 * unit, kDark.with_alpha(0.5));
  canvas.segments(rim.visible, 1.6 * unit, ink);
}

/// An arrow of one metre along a normal, camera frame.
void draw_normal(Canvas& canvas, const PinholeCamera& camera, const Occluders& occluders,
                 const Eigen::Vector3d& from, const Eigen::Vector3d& normal, const Color& ink,
                 double unit) {
  Segment2 arrow;
  if (!project_segment(camera, from, from + normal, &arrow)) return;
  const Eigen::Vector2d way = arrow.second - arrow.first;
  if (way.norm() < 4.0 * unit || occluders.hides(from, 0.02)) return;
  const double barb = std::min(0.3 * way.norm(), 7.0 * unit);
  const Eigen::Vector2d back = -way.normalized() * barb;
  const Eigen::Vector2d side = Eigen::Vector2d(-back.y(), back.x()) * 0.5;
  const std::vector<Segment2> lines = {arrow,
                                       {arrow.second, arrow.second + back + side},
                                       {arrow.second, arrow.second + back - side}};
  canvas.segments(lines, 3.4 * unit, kDark.with_alpha(0.6));
  canvas.segments(lines, 1.8 * unit, ink);
  canvas.disc(arrow.first, 2.4 * unit, ink);
}

/// Patches of the road, farthest first, under the vehicles. Returns what may not be covered.
std::vector<Box2> draw_road(Canvas& canvas, Image& image, const PinholeCamera& camera,
                            const Occluders& occluders, const std::vector<Drawn>& all,
                            const OverlayRoad& road, const OverlayOptions& options, double unit) {
  std::vector<Box2> taken;
  const bool tint = options.show_mask && road.mask;
  const bool patches =
      options.show_patches || options.show_normals || options.show_grade || options.show_grid;
  if (!tint && !(patches && road.surface)) return taken;
  cv::Mat pixels(image.height, image.width, CV_8UC3, image.data.data());
  const cv::Mat before = pixels.clone();
  if (tint) tint_mask(pixels, *road.mask);
  if (!(patches && road.surface)) return taken;
  const SE3 camera_from_reference = road.reference_from_camera.inverse();
  const std::vector<DrawnPatch> placed =
      drawn_patches(*road.surface, camera, camera_from_reference);
  if (placed.empty()) return taken;
  if (options.show_grade) {
    auto [low, high] = grade_range(placed);
    if (options.grade_range) {
      low = options.grade_range->first * 180.0 / M_PI;
      high = options.grade_range->second * 180.0 / M_PI;
    }
    for (const DrawnPatch& p : placed) {
      const double share = (p.patch->grade * 180.0 / M_PI - low) / (high - low);
      canvas.polygon(project_polygon(camera, p.rim), viridis(share).with_alpha(0.5));
    }
    restore_vehicles(pixels, before, camera, all);
    taken.push_back(draw_grade_bar(canvas, low, high, unit));
  }
  if (options.show_grid) {
    const RoadGrid grid = road_grid(*road.surface, camera_from_reference);
    draw_grid(canvas, camera, occluders, grid, options.metric, unit, &taken);
  }
  for (const DrawnPatch& p : placed) {
    const Color ink = p.patch->kind == PatchKind::kRoad       ? Color{90, 170, 255, 1.0}
                      : p.patch->kind == PatchKind::kPavement ? Color{240, 170, 90, 1.0}
                      : p.patch->kind == PatchKind::kGround   ? Color{130, 210, 130, 1.0}
                                                              : Color{200, 200, 200, 1.0};
    if (options.show_patches) draw_outline(canvas, camera, occluders, p, ink, unit);
    const Eigen::Vector3d& normal = p.patch->plane.plane.normal;
    if (options.show_normals && normal.allFinite()) {
      draw_normal(canvas, camera, occluders, p.middle,
                  camera_from_reference.rotation_matrix() * normal, ink, unit);
    }
  }
  return taken;
}

/// The position's ellipse of one standard deviation on the vehicle's plane, thin where a body hides
/// it. One that reaches as far as the camera shows nothing and is left out.
void draw_ellipse(Canvas& canvas, const PinholeCamera& camera, const Occluders& occluders,
                  const Drawn& drawn, double unit) {
  const VehicleEstimate& v = *drawn.vehicle;
  const Eigen::Matrix3d covariance = v.covariance.topLeftCorner<3, 3>();
  const Eigen::Vector3d n = v.plane.normal;
  if (!covariance.allFinite() || !n.allFinite() || std::abs(n.norm() - 1.0) > 1e-3) return;
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = n.unitOrthogonal();
  basis.col(1) = n.cross(basis.col(0));
  const Eigen::Matrix2d level = basis.transpose() * covariance * basis;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(0.5 * (level + level.transpose()));
  if (solver.info() != Eigen::Success || !(level.trace() > 0.0)) return;
  const Eigen::Vector2d radii = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  if (!(radii.maxCoeff() < drawn.range)) return;
  const Eigen::Vector3d center = v.plane.foot(v.pose.bottom_center());
  if (!center.allFinite()) return;
  constexpr int kSteps = 72;
  SplitLines rim;
  const auto at = [&](int step) {
    const double angle = 2.0 * M_PI * step / kSteps;
    return Eigen::Vector3d(
        center + basis * (solver.eigenvectors() * Eigen::Vector2d(radii.x() * std::cos(angle),
                                                                  radii.y() * std::sin(angle))));
  };
  for (int step = 0; step < kSteps; ++step) {
    rim.add(camera, occluders, at(step), at(step + 1), 1, 0.02);
  }
  canvas.segments(rim.hidden, 2.2 * unit, kDark.with_alpha(0.5));
  canvas.segments(rim.hidden, 1.0 * unit, {255, 255, 255, 0.8});
  canvas.segments(rim.visible, 3.4 * unit, kDark.with_alpha(0.7));
  canvas.segments(rim.visible, 1.8 * unit, {255, 255, 255, 1.0});
}

std::string distance_text(const Drawn& drawn, bool metric, bool with_sigma) {
  if (!drawn.box) return "no answer";
  std::string text = format_with_sigma(drawn.range, with_sigma ? range_sigma(*drawn.vehicle) : 0.0);
  if (metric) text += " m";
  if (drawn.vehicle->status == Status::kNotObservable) text += " ?";
  return text;
}

/// Labels: a badge with the number in the vehicle's colour and the distance on a dark plate.
void draw_labels(Canvas& canvas, const std::vector<Drawn>& all, double unit,
                 const OverlayOptions& options, const std::vector<Box2>& taken) {
  const auto words = [&](const Drawn& drawn) {
    return distance_text(drawn, options.metric, options.show_ellipses);
  };
  std::vector<Box2> drawings;
  for (const Drawn& drawn : all) drawings.push_back(drawn.reach);
  std::vector<const Drawn*> order;
  for (const Drawn& drawn : all) order.push_back(&drawn);
  std::stable_sort(order.begin(), order.end(),
                   [](const Drawn* a, const Drawn* b) { return a->range < b->range; });

  // The text shrinks until every label has a place; an image of some dozen pixels has none.
  for (double size = 20.0 * unit; size >= 7.0; size *= 0.85) {
    const double pad = 0.3 * size;
    std::vector<LabelRequest> requests;
    std::vector<double> badge_widths;
    for (const Drawn* drawn : order) {
      const Eigen::Vector2d id = Canvas::text_size(std::to_string(drawn->number), size, true);
      const Eigen::Vector2d text = Canvas::text_size(words(*drawn), size, true);
      badge_widths.push_back(id.x() + 2.0 * pad);
      const double height = std::ceil(std::max(id.y(), text.y()) + 0.3 * pad);
      requests.push_back({{badge_widths.back() + text.x() + 2.0 * pad, height}, drawn->reach});
      if (options.label_memory) {
        const auto before = options.label_memory->candidates.find(drawn->number);
        if (before != options.label_memory->candidates.end()) {
          requests.back().preferred = before->second;
        }
      }
    }
    LabelLayoutOptions layout;
    layout.area = {2.0, 2.0, canvas.width() - 3.0, canvas.height() - 3.0};
    layout.gap = 0.25 * size;
    layout.avoid = drawings;
    layout.taken = taken;
    const std::vector<LabelPlace> places = place_labels(requests, layout);
    const bool complete = std::all_of(places.begin(), places.end(),
                                      [](const LabelPlace& place) { return place.found; });
    if (!complete && size * 0.85 >= 7.0) continue;
    if (options.label_memory) {
      options.label_memory->candidates.clear();
      for (std::size_t i = 0; i < places.size(); ++i) {
        options.label_memory->candidates[order[i]->number] = places[i].candidate;
      }
    }
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (!places[i].found || !places[i].leader) continue;
      const Box2& target = order[i]->reach;
      const Eigen::Vector2d from = places[i].box.center();
      const Eigen::Vector2d to(std::clamp(from.x(), target.x1, target.x2),
                               std::clamp(from.y(), target.y1, target.y2));
      canvas.segments({{from, to}}, 2.5 * unit, kDark.with_alpha(0.6));
      canvas.segments({{from, to}}, 1.2 * unit, order[i]->color);
    }
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (!places[i].found) continue;
      const Box2& box = places[i].box;
      const double middle = box.center().y();
      canvas.rectangle(box, kDark.with_alpha(0.8), 0.2 * size);
      const Box2 badge{box.x1, box.y1, box.x1 + badge_widths[i], box.y2};
      canvas.rectangle(badge, order[i]->color, 0.2 * size);
      canvas.text({badge.center().x(), middle}, std::to_string(order[i]->number), size, kDark,
                  TextAnchor::kCenter, true);
      canvas.text({badge.x2 + pad, middle}, words(*order[i]), size, {255, 255, 255, 1.0},
                  TextAnchor::kLeft, true);
    }
    return;
  }
}

void require_fitting(const Image& photo, const PinholeCamera& camera, const OverlayRoad& road) {
  if (photo.width != camera.width || photo.height != camera.height) {
    throw std::invalid_argument("overlay: found an image of " + std::to_string(photo.width) +
                                " x " + std::to_string(photo.height) +
                                " pixels, expected the camera's " + std::to_string(camera.width) +
                                " x " + std::to_string(camera.height));
  }
  if (road.mask && (road.mask->width != photo.width || road.mask->height != photo.height ||
                    road.mask->channels != 1)) {
    throw std::invalid_argument(
        "overlay: found a road mask of " + std::to_string(road.mask->width) + " x " +
        std::to_string(road.mask->height) + " pixels and " + std::to_string(road.mask->channels) +
        " channels, expected one channel of the image's size");
  }
}

Image resized(const Image& photo, double factor) {
  Image out = make_picture(std::max(1, static_cast<int>(std::lround(photo.width * factor))),
                           std::max(1, static_cast<int>(std::lround(photo.height * factor))), 0);
  const cv::Mat from(photo.height, photo.width, CV_8UC3,
                     const_cast<std::uint8_t*>(photo.data.data()));
  cv::Mat to(out.height, out.width, CV_8UC3, out.data.data());
  cv::resize(from, to, to.size(), 0, 0, factor > 1.0 ? cv::INTER_CUBIC : cv::INTER_AREA);
  return out;
}

/// From pixels of the photo to those of the picture.
struct PixelScale {
  double x = 1.0, y = 1.0;

  Box2 of(const Box2& b) const {
    return {(b.x1 + 0.5) * x - 0.5, (b.y1 + 0.5) * y - 0.5, (b.x2 + 0.5) * x - 0.5,
            (b.y2 + 0.5) * y - 0.5};
  }
  PinholeCamera of(const PinholeCamera& camera, const Image& picture) const {
    return {picture.width,
            picture.height,
            camera.fx * x,
            camera.fy * y,
            (camera.cx + 0.5) * x - 0.5,
            (camera.cy + 0.5) * y - 0.5};
  }
};

/// The vehicles that have a place in the picture, farthest first.
std::vector<Drawn> drawn_vehicles(const VehicleFrame& frame, const PinholeCamera& camera,
                                  const PixelScale& scale, const VehicleNumbers& numbers) {
  std::vector<Drawn> all;
  for (const VehicleEstimate& vehicle : frame.vehicles) {
    Drawn drawn;
    drawn.vehicle = &vehicle;
    drawn.number = numbers.of(frame.id, vehicle);
    const auto corners = vehicle.pose.corners();
    drawn.box = has_box(vehicle) && corners.row(2).minCoeff() > kNear;
    drawn.wireframe = drawn.box && has_wireframe(vehicle);
    drawn.range = drawn.box ? vehicle.pose.bottom_center().norm() : 1e9;
    drawn.color = drawn.box && vehicle.status != Status::kNotObservable
                      ? brighter(categorical(drawn.number))
                      : kUntrusted;
    drawn.reach = scale.of(vehicle.box);
    if (drawn.box) {
      Box2 reach{1e30, 1e30, -1e30, -1e30};
      for (int i = 0; i < 8; ++i) reach = united(reach, *camera.project(corners.col(i)));
      drawn.reach = reach;
    }
    const Eigen::Vector4d sides(drawn.reach.x1, drawn.reach.y1, drawn.reach.x2, drawn.reach.y2);
    if (!sides.allFinite()) continue;
    drawn.reach = drawn.reach.clipped(camera.width, camera.height);
    drawn.pixel_height = drawn.reach.height();
    all.push_back(drawn);
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Drawn& a, const Drawn& b) { return a.range > b.range; });
  return all;
}

/// The detection's box, dashed for a vehicle without an answer.
void draw_box_2d(Canvas& canvas, const PinholeCamera& camera, const PixelScale& scale,
                 const Drawn& drawn, double unit) {
  const Box2 b = scale.of(drawn.vehicle->box).clipped(camera.width, camera.height);
  const Eigen::Vector2d c[4] = {{b.x1, b.y1}, {b.x2, b.y1}, {b.x2, b.y2}, {b.x1, b.y2}};
  const std::vector<Segment2> rim = {{c[0], c[1]}, {c[1], c[2]}, {c[2], c[3]}, {c[3], c[0]}};
  if (drawn.box) {
    canvas.segments(rim, 1.0 * unit, drawn.color.with_alpha(0.6));
  } else {
    canvas.dashed(rim, 5.0 * unit, 4.0 * unit, 1.5 * unit, drawn.color);
  }
}

}  // namespace

void OverlayOptions::validate() const {
  check_range("upscale", upscale, 0.1, 16.0);
  check_range("line_scale", line_scale, 0.2, 5.0);
}

Image draw_overlay(const Image& photo, const PinholeCamera& original_camera,
                   const VehicleFrame& frame, const OverlayOptions& options,
                   const OverlayRoad& road) {
  options.validate();
  require_picture(photo, "overlay: image");
  original_camera.validate();
  require_fitting(photo, original_camera, road);

  Image image = options.upscale == 1.0 ? photo : resized(photo, options.upscale);
  const PixelScale scale{static_cast<double>(image.width) / photo.width,
                         static_cast<double>(image.height) / photo.height};
  const PinholeCamera camera =
      options.upscale == 1.0 ? original_camera : scale.of(original_camera, image);
  const double unit = options.line_scale * std::max(0.6, image.width / 1242.0);

  Canvas canvas(image);
  const std::vector<Drawn> all = drawn_vehicles(frame, camera, scale, options.numbers);
  Occluders occluders;
  for (const Drawn& drawn : all) {
    if (drawn.wireframe) occluders.add(drawn.vehicle->keypoints);
  }

  const std::vector<Box2> taken =
      draw_road(canvas, image, camera, occluders, all, road, options, unit);
  if (options.show_planes) {
    for (const Drawn& drawn : all) {
      if (drawn.box) draw_plane_grid(canvas, camera, occluders, drawn, unit);
    }
  }
  if (options.show_boxes_2d) {
    for (const Drawn& drawn : all) draw_box_2d(canvas, camera, scale, drawn, unit);
  }
  for (const Drawn& drawn : all) {
    if (drawn.box && options.show_boxes_3d) {
      draw_box_3d(canvas, camera, occluders, drawn, unit);
    }
    if (drawn.wireframe) draw_wireframe(canvas, camera, occluders, drawn, unit);
  }
  if (options.show_ellipses) {
    for (const Drawn& drawn : all) {
      if (drawn.box) draw_ellipse(canvas, camera, occluders, drawn, unit);
    }
  }
  if (options.show_labels) draw_labels(canvas, all, unit, options, taken);
  return image;
}

}  // namespace camber
