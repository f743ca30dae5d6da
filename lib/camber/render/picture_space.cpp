#include "camber/render/picture_space.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/render/color_map.h"
#include "camber/render/detail/point_colors.h"
#include "camber/render/wireframe.h"
#include "camber/scene/vehicle_numbers.h"

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

bool is_metric(const PictureContent& content) {
  if (content.run) return content.run->metric;
  if (content.surface) return content.surface->metric;
  return content.cloud == nullptr || content.cloud->metric;
}

/// Nothing where lengths are up to scale: the truth is in metres.
const SceneTruth* truth_of(const PictureContent& content, bool show_truth) {
  return show_truth && is_metric(content) ? content.truth : nullptr;
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

/// Unit, names of the axes, and the pose in the reference frame: heights count from the road below
/// the reference camera, along up.
/// @param axes  rows right, ahead, up in the reference frame
void choose_frame(const PictureContent& content, const Eigen::Matrix3d& axes, bool camera_frame,
                  PictureSpace* space) {
  space->unit = is_metric(content) ? "m" : "units";

  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  space->map = !camera_frame;
  space->right_name = "right of the camera";
  space->ahead_name = "ahead of the camera";
  space->height_name = "height above the camera";
  if (space->map) {
    // A map cloud may lie far from its frame's origin: it is drawn about its own.
    const Eigen::Vector3d origin = content.cloud         ? content.cloud->origin
                                   : content.truth_cloud ? content.truth_cloud->origin
                                                         : Eigen::Vector3d::Zero();
    shift = -(axes * origin);
    space->origin = -shift;
    space->right_name = content.projected ? "east" : "x";
    space->ahead_name = content.projected ? "north" : "y";
    space->height_name = "height";
  }
  if (camera_frame && content.surface && content.surface->ego_patch >= 0) {
    if (const PlanePatch* ego = find_patch(*content.surface, content.surface->ego_patch)) {
      const double slope = ego->plane.plane.normal.dot(axes.row(2).transpose());
      const double below = ego->plane.plane.offset / slope;
      if (slope > 0.1 && std::isfinite(below)) {
        shift.z() = below;
        space->height_name = "height above the road at the camera";
      }
    }
  }
  space->picture_from_reference = SE3(axes, shift);
}

/// The cloud's finite points.
void place_points(const RoadCloud& cloud, const Eigen::Matrix3d& axes, PictureSpace* space) {
  const Eigen::Vector3d shift = space->picture_from_reference.translation();
  const Eigen::Matrix3f rotation = axes.cast<float>();
  const Eigen::Vector3f translation = (axes * cloud.origin + shift).cast<float>();
  space->points.reserve(cloud.size());
  space->kept.reserve(cloud.size());
  for (const Eigen::Vector3f& p : cloud.points) {
    if (!p.allFinite()) continue;
    space->points.emplace_back(rotation * p + translation);
    space->kept.push_back(static_cast<std::uint32_t>(&p - cloud.points.data()));
  }
}

void place_truth_cloud(const PictureContent& content, PictureSpace* space) {
  const RoadCloud& truth = *content.truth_cloud;
  const SE3 placed = space->picture_from_reference * content.reference_from_truth_cloud;
  const Eigen::Matrix3f rotation = placed.rotation_matrix().cast<float>();
  const Eigen::Vector3f translation = (placed * truth.origin).cast<float>();
  space->truth_points.reserve(truth.size());
  for (const Eigen::Vector3f& p : truth.points) {
    if (p.allFinite()) space->truth_points.emplace_back(rotation * p + translation);
  }
}

/// @return picture_from_camera of the shown frame
SE3 place_cameras(const PictureContent& content, PictureSpace* space) {
  SE3 picture_from_current = space->picture_from_reference;
  if (content.run) {
    for (const RunDocument::CameraPose& pose : content.run->cameras) {
      const SE3 placed = space->picture_from_reference * pose.reference_from_camera;
      if (!placed.translation().allFinite() || !placed.rotation().coeffs().allFinite()) continue;
      if (pose.id == content.frame) {
        space->current_camera = static_cast<int>(space->cameras.size());
        picture_from_current = placed;
      }
      space->cameras.push_back(placed);
      space->camera_ids.push_back(pose.id);
    }
  }
  return picture_from_current;
}

/// @param number  over all frames
PlacedVehicle place_vehicle(const VehicleEstimate& vehicle, int number,
                            const SE3& picture_from_current) {
  PlacedVehicle placed;
  placed.id = vehicle.id;
  placed.number = number;
  placed.name = vehicle_name(vehicle, number);
  placed.status = vehicle.status;
  placed.box = vehicle.pose;
  placed.box.camera_from_vehicle = moved(vehicle.pose.camera_from_vehicle, picture_from_current);
  placed.range = vehicle.pose.bottom_center().norm();
  placed.range_sigma = range_sigma(vehicle);
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
  return placed;
}

PlacedVehicle place_vehicle(const TruthVehicle& vehicle, const SE3& picture_from_current) {
  PlacedVehicle placed;
  placed.id = placed.number = vehicle.id;
  placed.box = vehicle.pose;
  placed.box.camera_from_vehicle = moved(vehicle.pose.camera_from_vehicle, picture_from_current);
  placed.range = vehicle.pose.bottom_center().norm();
  if (vehicle.plane) {
    placed.ground = ground_under(vehicle.pose, *vehicle.plane, picture_from_current);
  }
  return placed;
}

/// Vehicles of the shown frame, estimated and true.
void place_vehicles(const PictureContent& content, bool show_truth, const SE3& picture_from_current,
                    PictureSpace* space) {
  if (content.vehicles) {
    const VehicleNumbers numbers(*content.vehicles);
    for (const VehicleFrame& frame : content.vehicles->frames) {
      if (frame.id != content.frame) continue;
      for (const VehicleEstimate& vehicle : frame.vehicles) {
        if (!has_box(vehicle)) continue;
        space->vehicles.push_back(
            place_vehicle(vehicle, numbers.of(frame.id, vehicle), picture_from_current));
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
        space->truth.push_back(place_vehicle(vehicle, picture_from_current));
      }
    }
  }
}

/// Patches and links.
void place_surface(const RoadSurface& surface, const Eigen::Matrix3d& axes, PictureSpace* space) {
  for (const PlanePatch& patch : surface.patches) {
    PlacedPatch placed;
    placed.id = patch.id;
    placed.kind = patch.kind;
    placed.status = patch.status;
    for (const Eigen::Vector3d& corner : patch.boundary) {
      if (corner.allFinite()) placed.boundary.push_back(space->picture_from_reference * corner);
    }
    if (placed.boundary.size() < 3) continue;
    for (const Eigen::Vector3d& corner : placed.boundary) placed.middle += corner;
    placed.middle /= static_cast<double>(placed.boundary.size());
    if (patch.plane.plane.normal.allFinite()) {
      placed.normal = axes * patch.plane.plane.normal;
    }
    space->patches.push_back(std::move(placed));
  }
  for (const PatchLink& link : surface.links) {
    const PlanePatch* a = find_patch(surface, link.a);
    const PlanePatch* b = find_patch(surface, link.b);
    if (!a || !b || !a->plane.centroid.allFinite() || !b->plane.centroid.allFinite()) continue;
    space->links.push_back({space->picture_from_reference * a->plane.centroid,
                            space->picture_from_reference * b->plane.centroid, link.valid,
                            link.height_step});
    if (link.valid && std::isfinite(link.height_step)) {
      space->link_steps.high = std::max(space->link_steps.high, std::abs(link.height_step));
    }
  }
}

/// The ranges of what is drawn: the bulk of the points decides; vehicles, patches and cameras join
/// where they are not far outside of it.
/// @param given  points of the cloud, finite or not
void find_extent(std::size_t given, PictureSpace* space) {
  std::vector<Eigen::Vector3d> things;
  for (const SE3& camera : space->cameras) things.push_back(camera.translation());
  for (const PlacedVehicle& vehicle : space->vehicles) things.push_back(vehicle.box.center());
  for (const PlacedVehicle& vehicle : space->truth) things.push_back(vehicle.box.center());
  for (const PlacedPatch& patch : space->patches) things.push_back(patch.middle);
  // A dense truth gives the extent where there is no estimated cloud.
  const std::vector<Eigen::Vector3f>& bulk =
      space->points.empty() ? space->truth_points : space->points;
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
  space->right = robust_range(values[0], q, 1.0 - q);
  space->ahead = robust_range(values[1], q, 1.0 - q);
  space->up = robust_range(values[2], q, 1.0 - q);
  space->heights = from_points ? robust_range(values[2], 0.02, 0.98) : space->up;
  const double reach_right = 10.0 + 0.5 * space->right.span();
  const double reach_ahead = 10.0 + 0.5 * space->ahead.span();
  const double reach_up = 5.0 + 0.5 * space->up.span();
  const RobustRange right = space->right, ahead = space->ahead, upward = space->up;
  for (const Eigen::Vector3d& x : things) {
    if (x.x() < right.low - reach_right || x.x() > right.high + reach_right ||
        x.y() < ahead.low - reach_ahead || x.y() > ahead.high + reach_ahead ||
        x.z() < upward.low - reach_up || x.z() > upward.high + reach_up) {
      continue;
    }
    widen(&space->right, x.x());
    widen(&space->ahead, x.y());
    widen(&space->up, x.z());
  }
}

/// Leaves out stray points, which would only speckle the margins, and what of a dense truth lies
/// outside of the frame.
void drop_strays(PictureSpace* space) {
  const RobustRange bounds[3] = {space->right, space->ahead, space->up};
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
  for (std::size_t i = 0; i < space->points.size(); ++i) {
    if (stray(space->points[i])) continue;
    // The frame holds all that is drawn.
    widen(&space->right, space->points[i].x());
    widen(&space->ahead, space->points[i].y());
    space->points[used] = space->points[i];
    space->kept[used++] = space->kept[i];
  }
  space->stray_points = space->points.size() - used;
  space->points.resize(used);
  space->kept.resize(used);
  const double widest = std::min(0.5, 0.05 * std::max(space->right.span(), space->ahead.span()));
  for (RobustRange* range : {&space->right, &space->ahead}) {
    const double margin = std::max(widest, 0.02 * range->span());
    range->low -= margin;
    range->high += margin;
  }
  // A dense truth may reach far beyond: only what lies in the frame is drawn.
  const double above = std::max(1.0, 0.15 * space->up.span());
  const auto outside = [&](const Eigen::Vector3f& p) {
    return !(p.x() >= space->right.low && p.x() <= space->right.high && p.y() >= space->ahead.low &&
             p.y() <= space->ahead.high && p.z() >= space->up.low - above &&
             p.z() <= space->up.high + above);
  };
  space->truth_points.erase(
      std::remove_if(space->truth_points.begin(), space->truth_points.end(), outside),
      space->truth_points.end());
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

  choose_frame(content, axes, camera_frame, &space);
  if (content.cloud) place_points(*content.cloud, axes, &space);
  if (content.truth_cloud) place_truth_cloud(content, &space);
  const SE3 picture_from_current = place_cameras(content, &space);
  place_vehicles(content, show_truth, picture_from_current, &space);
  if (content.surface) place_surface(*content.surface, axes, &space);
  space.link_steps.high = std::max(space.link_steps.high, 0.01);
  find_extent(content.cloud ? content.cloud->size() : 0, &space);
  drop_strays(&space);
  if (space.heights.span() < 0.1) {
    const double middle = 0.5 * (space.heights.low + space.heights.high);
    space.heights = {middle - 0.05, middle + 0.05};
  }
  if (!space.points.empty()) detail::color_points(content, up, color, &space);
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

Color darker(const Color& color, double share) {
  const auto mix = [&](int c) { return static_cast<std::uint8_t>(std::lround(c * share)); };
  return {mix(color.red), mix(color.green), mix(color.blue), color.alpha};
}

Color vehicle_color(Status status, int number) {
  if (status == Status::kNotObservable) return {120, 120, 120, 1.0};
  return categorical(number);
}

Color vehicle_color(const PlacedVehicle& vehicle) {
  return vehicle_color(vehicle.status, vehicle.number);
}

std::string range_text(const PlacedVehicle& vehicle, const std::string& unit, bool with_sigma) {
  return format_with_sigma(vehicle.range, with_sigma ? vehicle.range_sigma : 0.0) + " " + unit;
}

Color patch_color(PatchKind kind) {
  switch (kind) {
    case PatchKind::kRoad:
      return {20, 60, 130, 1.0};
    case PatchKind::kPavement:
      return {150, 80, 20, 1.0};
    case PatchKind::kGround:
      return {60, 110, 60, 1.0};
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

PointColor PointColor::parse(const std::string& word) {
  if (word == "height") return {By::kHeight, {}};
  if (word == "sigma") return {By::kSigma, {}};
  if (word == "patch") return {By::kPatch, {}};
  if (word == "image") return {By::kImage, {}};
  if (word == "error") return {By::kError, {}};
  return {By::kScalar, word};
}

}  // namespace camber
