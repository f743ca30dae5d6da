#include "camber/render/picture_space.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "camber/cloud/normals.h"
#include "camber/core/errors.h"
#include "camber/evaluate/compare.h"
#include "camber/render/color_map.h"
#include "camber/render/wireframe.h"

namespace camber {
namespace {

const PlanePatch* find_patch(const RoadSurface& surface, int id) {
  for (const PlanePatch& patch : surface.patches) {
    if (patch.id == id) return &patch;
  }
  return nullptr;
}

/// Rotation of the picture's axes: rows right, ahead, up in the reference frame.
Eigen::Matrix3d picture_axes(const Eigen::Vector3d& up_hint, bool camera_frame) {
  const Eigen::Vector3d up = up_hint.normalized();
  Eigen::Vector3d ahead = camera_frame ? Eigen::Vector3d(0, 0, 1) : Eigen::Vector3d(0, 1, 0);
  ahead -= up * up.dot(ahead);
  if (ahead.norm() < 1e-6) ahead = up.unitOrthogonal();
  ahead.normalize();
  Eigen::Matrix3d axes;
  axes.row(0) = ahead.cross(up);
  axes.row(1) = ahead;
  axes.row(2) = up;
  return axes;
}

SE3 moved(const SE3& pose, const SE3& picture_from_camera) { return picture_from_camera * pose; }

void widen(RobustRange* range, double value) {
  range->low = std::min(range->low, value);
  range->high = std::max(range->high, value);
}

const SceneTruth* truth_of(const PictureContent& content, bool show_truth) {
  return show_truth ? content.truth : nullptr;
}

/// The plane's rectangle under a box, half a metre larger; empty without a sound plane.
std::vector<Eigen::Vector3d> ground_under(const OrientedBox& box, const Plane& plane,
                                          const SE3& picture_from_camera) {
  if (!plane.normal.allFinite() || std::abs(plane.normal.norm() - 1.0) > 1e-3 ||
      !std::isfinite(plane.offset)) {
    return {};
  }
  const double l = 0.5 * box.dimensions.length + 0.5, w = 0.5 * box.dimensions.width + 0.5;
  std::vector<Eigen::Vector3d> corners;
  for (const auto& [x, z] : {std::pair{l, -w}, {l, w}, {-l, w}, {-l, -w}}) {
    const Eigen::Vector3d foot = plane.foot(box.camera_from_vehicle * Eigen::Vector3d(x, 0.0, z));
    if (!foot.allFinite()) return {};
    corners.push_back(picture_from_camera * foot);
  }
  return corners;
}

std::string with_thousands(std::size_t count) {
  std::string digits = std::to_string(count);
  for (int at = static_cast<int>(digits.size()) - 3; at > 0; at -= 3) {
    digits.insert(static_cast<std::size_t>(at), ",");
  }
  return digits;
}

std::string plural(std::size_t count, const char* one, const char* many) {
  return with_thousands(count) + " " + (count == 1 ? one : many);
}

std::vector<std::string> height_title(const PictureSpace& space) {
  if (space.height_name == "height above the road at the camera") {
    return {"height above the", "road at the camera", "(" + space.unit + ")"};
  }
  if (space.height_name == "height above the camera") {
    return {"height above", "the camera (" + space.unit + ")"};
  }
  if (space.height_name.size() < 10) return {space.height_name + " (" + space.unit + ")"};
  return {space.height_name, "(" + space.unit + ")"};
}

/// Signed distances to the dense truth, along the normal of its nearest point, up is positive, one
/// a point kept; NaN where the truth has no normal.
std::vector<float> truth_errors(const PictureContent& content, const Eigen::Vector3d& up,
                                const std::vector<std::uint32_t>& kept) {
  const SE3 truth_from_reference = content.reference_from_truth_cloud.inverse();
  std::vector<Eigen::Vector3d> places;
  places.reserve(kept.size());
  for (const std::uint32_t i : kept) {
    places.push_back(truth_from_reference *
                     (content.cloud->origin + content.cloud->points[i].cast<double>()));
  }
  Shape truth;
  truth.cloud.origin = content.truth_cloud->origin;
  truth.cloud.points = content.truth_cloud->points;
  NormalOptions normals;
  normals.up = truth_from_reference.rotation() * up;
  estimate_normals(truth.cloud, normals);
  const ShapeDistances found = distances_to(truth, places, 0);
  return {found.along_normal.begin(), found.along_normal.end()};
}

/// Colours for the points of a picture.
void color_points(const PictureContent& content, const Eigen::Vector3d& up, const PointColor& color,
                  PictureSpace* space) {
  const RoadCloud& cloud = *content.cloud;
  const std::vector<std::uint32_t>& kept = space->kept;
  const auto lacking = [&](const std::string& what) {
    throw NoAnswerError("the points cannot be coloured: the cloud has no " + what);
  };
  std::vector<float> values;
  values.reserve(kept.size());
  switch (color.by) {
    case PointColor::By::kImage:
      if (cloud.colors.empty()) lacking("colours");
      for (const std::uint32_t i : kept) space->colors.push_back(cloud.colors[i]);
      return;
    case PointColor::By::kPatch: {
      const auto found = cloud.labels.find("patch");
      if (found == cloud.labels.end()) lacking("label \"patch\"");
      for (const std::uint32_t i : kept) {
        const int patch = found->second[i];
        const Color ink = patch < 0 ? Color{170, 170, 170, 1.0} : categorical(patch);
        space->colors.push_back({ink.red, ink.green, ink.blue});
      }
      return;
    }
    case PointColor::By::kHeight:
      for (const Eigen::Vector3f& p : space->points) values.push_back(p.z());
      space->color_range = space->heights;
      space->color_title = height_title(*space);
      break;
    case PointColor::By::kSigma:
      if (cloud.sigmas.empty()) lacking("standard deviations");
      for (const std::uint32_t i : kept) values.push_back(cloud.sigmas[i]);
      space->color_title = {"standard", "deviation (" + space->unit + ")"};
      break;
    case PointColor::By::kError:
      if (content.truth_cloud) {
        values = truth_errors(content, up, kept);
        space->color_title = {"above (+) or", "below the", "truth (" + space->unit + ")"};
        space->color_scale = diverging;
        break;
      }
      if (cloud.scalars.find("error") == cloud.scalars.end()) {
        lacking("attribute \"error\", and there is no dense truth to measure against");
      }
      [[fallthrough]];
    case PointColor::By::kScalar: {
      const std::string name = color.by == PointColor::By::kError ? "error" : color.name;
      const auto scalar = cloud.scalars.find(name);
      const auto label = cloud.labels.find(name);
      if (scalar == cloud.scalars.end() && label == cloud.labels.end()) {
        lacking("attribute \"" + name + "\"");
      }
      for (const std::uint32_t i : kept) {
        values.push_back(scalar != cloud.scalars.end() ? scalar->second[i]
                                                       : static_cast<float>(label->second[i]));
      }
      space->color_title = {name};
      break;
    }
  }
  if (color.by != PointColor::By::kHeight) {
    std::vector<float> finite;
    for (const float value : values) {
      if (std::isfinite(value)) finite.push_back(value);
    }
    if (finite.empty()) lacking("finite value of what the colours should mean");
    space->color_range = robust_range(finite, 0.02, 0.98);
    if (!(space->color_range.span() > 0.0)) {
      const double half = std::max(1e-6, 1e-3 * std::abs(space->color_range.low));
      space->color_range = {space->color_range.low - half, space->color_range.high + half};
    }
  }
  if (space->color_scale == diverging) {
    const double reach =
        std::max(std::abs(space->color_range.low), std::abs(space->color_range.high));
    space->color_range = {-reach, reach};
  }
  space->has_color_bar = true;
  for (const float value : values) {
    const Color ink =
        space->color_scale((value - space->color_range.low) / space->color_range.span());
    space->colors.push_back({ink.red, ink.green, ink.blue});
  }
}

}  // namespace

RobustRange robust_range(std::vector<float>& values, double low_quantile, double high_quantile) {
  const auto at = [&](double quantile) {
    const auto index =
        static_cast<std::ptrdiff_t>(std::lround(quantile * static_cast<double>(values.size() - 1)));
    std::nth_element(values.begin(), values.begin() + index, values.end());
    return static_cast<double>(values[static_cast<std::size_t>(index)]);
  };
  const double low = at(low_quantile);
  return {low, at(high_quantile)};
}

PictureSpace make_picture_space(const PictureContent& content, bool show_truth,
                                const PointColor& color) {
  PictureSpace space;
  const bool camera_frame = content.surface ? content.surface->frame == "camera"
                            : content.cloud ? content.cloud->frame == CloudFrame::kCamera
                                            : true;
  const Eigen::Vector3d up = content.up        ? *content.up
                             : content.surface ? content.surface->up
                             : content.cloud   ? content.cloud->default_up()
                                               : Eigen::Vector3d(0, -1, 0);
  if (!up.allFinite() || up.norm() < 1e-9) {
    throw std::invalid_argument("the up direction is not a direction");
  }
  const Eigen::Matrix3d axes = picture_axes(up, camera_frame);

  bool metric = true;
  if (content.run)
    metric = content.run->metric;
  else if (content.surface)
    metric = content.surface->metric;
  else if (content.cloud)
    metric = content.cloud->metric;
  space.unit = metric ? "m" : "units";

  // Heights count from the road below the reference camera, along up.
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  space.map = !camera_frame;
  space.right_name = "right of the camera";
  space.ahead_name = "ahead of the camera";
  space.height_name = "height above the camera";
  if (space.map) {
    // A map cloud may lie far from its frame's origin: it is drawn about its own, which is named.
    const Eigen::Vector3d origin = content.cloud ? content.cloud->origin : Eigen::Vector3d::Zero();
    const auto name = [](const char* axis, double from) {
      return from == 0.0 ? std::string(axis) : axis + (" from " + format_number(from, 0));
    };
    space.right_name = name("x", origin.x());
    space.ahead_name = name("y", origin.y());
    space.height_name = name("height", origin.z());
  }
  if (camera_frame && content.surface && content.surface->ego_patch >= 0) {
    if (const PlanePatch* ego = find_patch(*content.surface, content.surface->ego_patch)) {
      const double slope = ego->plane.plane.normal.dot(axes.row(2).transpose());
      const double below = ego->plane.plane.offset / slope;
      if (slope > 0.1 && std::isfinite(below)) {
        shift.z() = below;
        space.height_name = "height above the road at the camera";
      }
    }
  }
  space.picture_from_reference = SE3(axes, shift);

  std::size_t given = 0;
  if (content.cloud) {
    given = content.cloud->size();
    const Eigen::Vector3d origin = content.cloud->origin;
    const Eigen::Vector3d start = camera_frame ? origin : Eigen::Vector3d::Zero();
    const Eigen::Matrix3f rotation = axes.cast<float>();
    const Eigen::Vector3f translation = (axes * start + shift).cast<float>();
    space.points.reserve(given);
    space.kept.reserve(given);
    for (const Eigen::Vector3f& p : content.cloud->points) {
      if (!p.allFinite()) continue;
      space.points.emplace_back(rotation * p + translation);
      space.kept.push_back(static_cast<std::uint32_t>(&p - content.cloud->points.data()));
    }
  }

  if (content.truth_cloud) {
    const RoadCloud& truth = *content.truth_cloud;
    const SE3 placed = space.picture_from_reference * content.reference_from_truth_cloud;
    const Eigen::Matrix3f rotation = placed.rotation_matrix().cast<float>();
    // Of a map, both clouds are drawn about the estimate's origin.
    Eigen::Vector3d base = Eigen::Vector3d::Zero();
    if (space.map) base = content.cloud ? content.cloud->origin : truth.origin;
    const Eigen::Vector3f translation = (placed * truth.origin - axes * base).cast<float>();
    space.truth_points.reserve(truth.size());
    for (const Eigen::Vector3f& p : truth.points) {
      if (p.allFinite()) space.truth_points.emplace_back(rotation * p + translation);
    }
  }

  // Cameras.
  SE3 picture_from_current = space.picture_from_reference;
  if (content.run) {
    for (const RunDocument::CameraPose& pose : content.run->cameras) {
      const SE3 placed = space.picture_from_reference * pose.reference_from_camera;
      if (!placed.translation().allFinite() || !placed.rotation().coeffs().allFinite()) continue;
      if (pose.id == content.frame) {
        space.current_camera = static_cast<int>(space.cameras.size());
        picture_from_current = placed;
      }
      space.cameras.push_back(placed);
      space.camera_ids.push_back(pose.id);
    }
  }

  // Vehicles of the shown frame.
  if (content.vehicles) {
    for (const VehicleFrame& frame : content.vehicles->frames) {
      if (frame.id != content.frame) continue;
      for (const VehicleEstimate& vehicle : frame.vehicles) {
        if (!has_box(vehicle)) continue;
        PlacedVehicle placed;
        placed.id = vehicle.id;
        placed.name = (vehicle.vehicle_class.empty() ? "vehicle" : vehicle.vehicle_class) + " " +
                      std::to_string(vehicle.id);
        placed.status = vehicle.status;
        placed.box = vehicle.pose;
        placed.box.camera_from_vehicle =
            moved(vehicle.pose.camera_from_vehicle, picture_from_current);
        placed.range = vehicle.pose.bottom_center().norm();
        placed.ground = ground_under(vehicle.pose, vehicle.plane, picture_from_current);
        placed.wireframe = has_wireframe(vehicle);
        for (int i = 0; i < kNumKeypoints && placed.wireframe; ++i) {
          placed.keypoints[i] = picture_from_current * vehicle.keypoints[i];
        }
        const Eigen::Matrix3d rotation = picture_from_current.rotation_matrix();
        const Eigen::Matrix3d covariance = vehicle.covariance.topLeftCorner<3, 3>();
        if (covariance.allFinite()) {
          placed.center_covariance = rotation * covariance * rotation.transpose();
        }
        space.vehicles.push_back(placed);
      }
    }
  }
  if (const SceneTruth* truth = truth_of(content, show_truth)) {
    for (const TruthFrame& frame : truth->frames) {
      if (frame.id != content.frame) continue;
      for (const TruthVehicle& vehicle : frame.vehicles) {
        const Dimensions& d = vehicle.pose.dimensions;
        if (!vehicle.pose.bottom_center().allFinite() || !(d.length > 0.0) || !(d.width > 0.0) ||
            !(d.height > 0.0)) {
          continue;
        }
        PlacedVehicle placed;
        placed.id = vehicle.id;
        placed.box = vehicle.pose;
        placed.box.camera_from_vehicle =
            moved(vehicle.pose.camera_from_vehicle, picture_from_current);
        placed.range = vehicle.pose.bottom_center().norm();
        if (vehicle.plane) {
          placed.ground = ground_under(vehicle.pose, *vehicle.plane, picture_from_current);
        }
        space.truth.push_back(placed);
      }
    }
  }
  if (content.surface) {
    for (const PlanePatch& patch : content.surface->patches) {
      PlacedPatch placed;
      placed.id = patch.id;
      placed.kind = patch.kind;
      placed.status = patch.status;
      for (const Eigen::Vector3d& corner : patch.boundary) {
        if (corner.allFinite()) placed.boundary.push_back(space.picture_from_reference * corner);
      }
      if (placed.boundary.size() < 3) continue;
      for (const Eigen::Vector3d& corner : placed.boundary) placed.middle += corner;
      placed.middle /= static_cast<double>(placed.boundary.size());
      if (patch.plane.plane.normal.allFinite()) {
        placed.normal = axes * patch.plane.plane.normal;
      }
      space.patches.push_back(std::move(placed));
    }
    for (const PatchLink& link : content.surface->links) {
      const PlanePatch* a = find_patch(*content.surface, link.a);
      const PlanePatch* b = find_patch(*content.surface, link.b);
      if (!a || !b || !a->plane.centroid.allFinite() || !b->plane.centroid.allFinite()) continue;
      space.links.push_back({space.picture_from_reference * a->plane.centroid,
                             space.picture_from_reference * b->plane.centroid, link.valid,
                             link.height_step});
      if (link.valid && std::isfinite(link.height_step)) {
        space.link_steps.high = std::max(space.link_steps.high, std::abs(link.height_step));
      }
    }
  }

  space.link_steps.high = std::max(space.link_steps.high, 0.01);

  // Extents: the bulk of the points decides; vehicles, patches and cameras join where they are not
  // far outside of it.
  std::vector<Eigen::Vector3d> things;
  for (const SE3& camera : space.cameras) things.push_back(camera.translation());
  for (const PlacedVehicle& vehicle : space.vehicles) things.push_back(vehicle.box.center());
  for (const PlacedVehicle& vehicle : space.truth) things.push_back(vehicle.box.center());
  for (const PlacedPatch& patch : space.patches) things.push_back(patch.middle);
  // A dense truth gives the extent where there is no estimated cloud.
  const std::vector<Eigen::Vector3f>& bulk =
      space.points.empty() ? space.truth_points : space.points;
  if (bulk.empty() && things.empty()) {
    if (given > 0) {
      throw NoAnswerError("nothing to draw: none of the " + std::to_string(given) +
                          " points has finite coordinates");
    }
    throw NoAnswerError("nothing to draw: no points, no patches, no vehicles, no cameras");
  }
  std::vector<float> values[3];
  for (int axis = 0; axis < 3; ++axis) {
    if (bulk.size() >= 8) {
      values[axis].reserve(bulk.size());
      for (const Eigen::Vector3f& p : bulk) values[axis].push_back(p[axis]);
    } else if (axis == 0) {
      for (const Eigen::Vector3f& p : bulk) things.push_back(p.cast<double>());
    }
    if (values[axis].empty()) {
      for (const Eigen::Vector3d& x : things) values[axis].push_back(static_cast<float>(x[axis]));
    }
  }
  const bool from_points = bulk.size() >= 8;
  const double q = from_points ? 0.01 : 0.0;
  space.right = robust_range(values[0], q, 1.0 - q);
  space.ahead = robust_range(values[1], q, 1.0 - q);
  space.up = robust_range(values[2], q, 1.0 - q);
  space.heights = from_points ? robust_range(values[2], 0.02, 0.98) : space.up;
  const double reach_right = 10.0 + 0.5 * space.right.span();
  const double reach_ahead = 10.0 + 0.5 * space.ahead.span();
  const double reach_up = 5.0 + 0.5 * space.up.span();
  const RobustRange right = space.right, ahead = space.ahead, upward = space.up;
  for (const Eigen::Vector3d& x : things) {
    if (x.x() < right.low - reach_right || x.x() > right.high + reach_right ||
        x.y() < ahead.low - reach_ahead || x.y() > ahead.high + reach_ahead ||
        x.z() < upward.low - reach_up || x.z() > upward.high + reach_up) {
      continue;
    }
    widen(&space.right, x.x());
    widen(&space.ahead, x.y());
    widen(&space.up, x.z());
  }
  // Stray points would only speckle the margins.
  const RobustRange bounds[3] = {space.right, space.ahead, space.up};
  const auto stray = [&](const Eigen::Vector3f& p) {
    for (int axis = 0; axis < 3; ++axis) {
      const double margin = std::max(1.0, 0.15 * bounds[axis].span());
      if (p[axis] < bounds[axis].low - margin || p[axis] > bounds[axis].high + margin) {
        return true;
      }
    }
    return false;
  };
  std::size_t used = 0;
  for (std::size_t i = 0; i < space.points.size(); ++i) {
    if (stray(space.points[i])) continue;
    // The frame holds all that is drawn.
    widen(&space.right, space.points[i].x());
    widen(&space.ahead, space.points[i].y());
    space.points[used] = space.points[i];
    space.kept[used++] = space.kept[i];
  }
  space.stray_points = space.points.size() - used;
  space.points.resize(used);
  space.kept.resize(used);
  const double widest = std::min(0.5, 0.05 * std::max(space.right.span(), space.ahead.span()));
  for (RobustRange* range : {&space.right, &space.ahead}) {
    const double margin = std::max(widest, 0.02 * range->span());
    range->low -= margin;
    range->high += margin;
  }
  // A dense truth may reach far beyond: only what lies in the frame is drawn.
  const double above = std::max(1.0, 0.15 * space.up.span());
  const auto outside = [&](const Eigen::Vector3f& p) {
    return !(p.x() >= space.right.low && p.x() <= space.right.high && p.y() >= space.ahead.low &&
             p.y() <= space.ahead.high && p.z() >= space.up.low - above &&
             p.z() <= space.up.high + above);
  };
  space.truth_points.erase(
      std::remove_if(space.truth_points.begin(), space.truth_points.end(), outside),
      space.truth_points.end());
  if (space.heights.span() < 0.1) {
    const double middle = 0.5 * (space.heights.low + space.heights.high);
    space.heights = {middle - 0.05, middle + 0.05};
  }
  if (!space.points.empty()) color_points(content, up, color, &space);
  return space;
}

std::array<Eigen::Vector3d, 4> frustum_corners(const PinholeCamera& camera, double depth) {
  const double right = camera.width - 0.5, bottom = camera.height - 0.5;
  return {camera.ray({-0.5, -0.5}) * depth, camera.ray({right, -0.5}) * depth,
          camera.ray({right, bottom}) * depth, camera.ray({-0.5, bottom}) * depth};
}

std::string content_summary(const PictureContent& content, const PictureSpace& space) {
  std::string text;
  const auto add = [&](const std::string& part) {
    if (!text.empty()) text += ", ";
    text += part;
  };
  if (content.cloud) {
    const bool road = !space.map;
    add(plural(space.points.size(), road ? "road point" : "point",
               road ? "road points" : "points"));
    if (space.stray_points > 0) {
      text += " (" + with_thousands(space.stray_points) + " stray ones left out)";
    }
  }
  if (content.surface) add(plural(space.patches.size(), "patch", "patches"));
  if (content.vehicles) add(plural(space.vehicles.size(), "vehicle", "vehicles"));
  if (content.vehicles || content.run) {
    text = "frame " + std::to_string(content.frame) + (text.empty() ? "" : ": ") + text;
  }
  return text;
}

namespace {

double legend_entry_width(const LegendEntry& entry, double text_size) {
  return 2.0 * text_size + Canvas::text_size(entry.text, text_size).x();
}

}  // namespace

int count_legend_rows(double width, const std::vector<LegendEntry>& entries, double text_size) {
  int rows = entries.empty() ? 0 : 1;
  double x = 0.0;
  for (const LegendEntry& entry : entries) {
    const double own = legend_entry_width(entry, text_size);
    if (x > 0.0 && x + own > width) {
      x = 0.0;
      ++rows;
    }
    x += own + 1.1 * text_size;
  }
  return rows;
}

void draw_legend(Canvas& canvas, const Eigen::Vector2d& at, double right_limit,
                 const std::vector<LegendEntry>& entries, double text_size) {
  Eigen::Vector2d cursor = at;
  const double mark = 1.6 * text_size, gap = 1.1 * text_size;
  for (const LegendEntry& entry : entries) {
    const double width = legend_entry_width(entry, text_size);
    if (cursor.x() > at.x() && cursor.x() + width > right_limit) {
      cursor = {at.x(), cursor.y() + 1.3 * text_size};
    }
    const Eigen::Vector2d end = cursor + Eigen::Vector2d(mark, 0.0);
    const Eigen::Vector2d middle = 0.5 * (cursor + end);
    const double thick = std::max(1.5, text_size / 8.0);
    switch (entry.mark) {
      case LegendEntry::Mark::kLine:
        canvas.segments({{cursor, end}}, thick, entry.color);
        break;
      case LegendEntry::Mark::kDashedLine:
        canvas.dashed({{cursor, end}}, 0.35 * text_size, 0.25 * text_size, thick, entry.color);
        break;
      case LegendEntry::Mark::kFill: {
        const Box2 box{cursor.x(), cursor.y() - 0.4 * text_size, end.x(),
                       cursor.y() + 0.4 * text_size};
        canvas.rectangle(box, entry.color.with_alpha(0.35 * entry.color.alpha));
        canvas.polyline({{box.x1, box.y1}, {box.x2, box.y1}, {box.x2, box.y2}, {box.x1, box.y2}},
                        true, 0.7 * thick, entry.color);
        break;
      }
      case LegendEntry::Mark::kDot:
        canvas.disc(middle, 0.28 * text_size, entry.color);
        break;
      case LegendEntry::Mark::kEllipse: {
        std::vector<Eigen::Vector2d> rim;
        for (int i = 0; i < 32; ++i) {
          const double angle = 2.0 * M_PI * i / 32.0;
          rim.push_back(middle + Eigen::Vector2d(0.5 * mark * std::cos(angle),
                                                 0.4 * text_size * std::sin(angle)));
        }
        canvas.polyline(rim, true, 0.8 * thick, entry.color);
        break;
      }
    }
    canvas.text({end.x() + 0.4 * text_size, cursor.y()}, entry.text, text_size, kInk);
    cursor.x() += width + gap;
  }
}

Color darker(const Color& color, double share) {
  const auto mix = [&](int c) { return static_cast<std::uint8_t>(std::lround(c * share)); };
  return {mix(color.red), mix(color.green), mix(color.blue), color.alpha};
}

Color vehicle_color(const PlacedVehicle& vehicle) {
  if (vehicle.status == Status::kNotObservable) return {120, 120, 120, 1.0};
  return categorical(vehicle.id);
}

Color patch_color(PatchKind kind) {
  switch (kind) {
    case PatchKind::kRoad:
      return {20, 60, 130, 1.0};
    case PatchKind::kPavement:
      return {150, 80, 20, 1.0};
    case PatchKind::kOther:
      break;
  }
  return {120, 120, 120, 1.0};
}

void check_picture_option(const char* name, double value, double low, double high) {
  if (value >= low && value <= high) return;
  char text[160];
  std::snprintf(text, sizeof(text), "found %.9g, expected %.9g to %.9g", value, low, high);
  throw std::invalid_argument("picture option " + std::string(name) + ": " + text);
}

std::vector<LegendEntry> make_legend(const PictureSpace& space, const std::string& cameras) {
  std::vector<LegendEntry> entries;
  bool road = false, pavement = false, other = false;
  for (const PlacedPatch& patch : space.patches) {
    road |= patch.kind == PatchKind::kRoad;
    pavement |= patch.kind == PatchKind::kPavement;
    other |= patch.kind == PatchKind::kOther;
  }
  using Mark = LegendEntry::Mark;
  if (road) entries.push_back({Mark::kFill, patch_color(PatchKind::kRoad), "road patch"});
  if (pavement) {
    entries.push_back({Mark::kFill, patch_color(PatchKind::kPavement), "pavement patch"});
  }
  if (other) entries.push_back({Mark::kFill, patch_color(PatchKind::kOther), "other patch"});
  if (!space.vehicles.empty()) {
    entries.push_back({Mark::kFill, categorical(1), "estimated vehicle"});
  }
  if (!space.truth.empty()) entries.push_back({Mark::kLine, kTruthRed, "true box"});
  if (!space.truth_points.empty()) {
    entries.push_back({Mark::kDot, kTruthGrey, "dense ground truth"});
  }
  if (!space.cameras.empty()) {
    entries.push_back({Mark::kLine, kInk, cameras});
  }
  return entries;
}

PointColor PointColor::parse(const std::string& word) {
  if (word == "height") return {By::kHeight, {}};
  if (word == "sigma") return {By::kSigma, {}};
  if (word == "patch") return {By::kPatch, {}};
  if (word == "image") return {By::kImage, {}};
  if (word == "error") return {By::kError, {}};
  return {By::kScalar, word};
}

}  // namespace camber
