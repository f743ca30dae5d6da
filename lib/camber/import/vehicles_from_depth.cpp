#include "camber/import/vehicles_from_depth.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "camber/import/detail/depth_surface.h"
#include "camber/import/import_common.h"
#include "camber/vehicle/shape_prior.h"

namespace camber {
namespace {

// Chosen on made scenes of even numbers (docs/notes/synthia-truth.md).
constexpr double kPi = 3.14159265358979323846, kDegree = kPi / 180.0;
constexpr double kBandFrom = 0.15;  // m above the ground: the body's lower part
constexpr double kBandTo = 0.65;    // of the vehicle's height: below mirrors and windows
constexpr double kSteep = 0.5;      // of the normal's upward part, largest
constexpr double kHeadingKernel = 1.5 * kDegree;
constexpr double kFlat = 6.0 * kDegree;         // of a side's normals about its own
constexpr double kEndNormals = 50.0 * kDegree;  // of an end's normals about its own
constexpr double kMiddleNormals = 35.0 * kDegree;
constexpr double kShortestSide = 1.8;           // m of flat surface
constexpr double kNarrowestEnd = 1.1;           // m between normals of kMiddleNormals
constexpr double kGrazingSide = 7.0 * kDegree;  // least angle of view on the side
constexpr double kHiddenEdge = 0.1;             // of the silhouette's rows
constexpr double kMostHidden = 0.8;
constexpr double kWheelsSeen = 0.15;                    // m above the ground, of the lowest point
constexpr double kWheelCorrection = 0.3;                // m, largest
constexpr double kRoof = 0.93;                          // of the height: the roof begins
constexpr double kTailRoof = 0.25, kBonnetRoof = 0.34;  // of the length from the end: see there
constexpr double kExtreme = 0.002;                      // quantile that stands for an extreme
constexpr std::size_t kFewest = 20;                     // pixels of a face

/// Difference of directions modulo 90 degrees, in [-45, 45) degrees.
double quarter_difference(double angle) {
  const double quarter = 0.5 * kPi;
  angle = std::fmod(angle + 0.5 * quarter, quarter);
  return (angle < 0.0 ? angle + quarter : angle) - 0.5 * quarter;
}

/// A vehicle's surface over the ground: plan coordinates x (along) and y (across), height h.
class VehicleFit {
 public:
  VehicleFit(const VehicleRegion& region, const LabelledDepth& image, const PinholeCamera& camera)
      : region_(region),
        image_(image),
        camera_(camera),
        surface_(surface_of(region, *image.depth, camera)) {}

  std::optional<TruthVehicle> run(const std::string& vehicle_class) {
    const std::optional<Plane> ground = ground_beside(region_, surface_, image_, camera_);
    if (!ground) flag(box_flags::kGround);
    ground_ = ground ? *ground : upright_ground();
    for (int round = 0; round < 2; ++round) {
      place();
      if (!find_heading() || !find_side()) return std::nullopt;
      if (round == 0 && side_seen_) stand_on_wheels();
    }
    orient();
    const Eigen::Vector3d prior = shipped_vehicle_prior().size(vehicle_class).mean;
    measure({prior.x(), prior.y(), prior.z()});
    judge_silhouette();
    TruthVehicle out = vehicle(vehicle_class);
    if (out.occlusion > kMostHidden) return std::nullopt;
    return out;
  }

 private:
  std::size_t size() const { return surface_.points.size(); }
  void flag(const char* reason) {
    if (flag_.empty()) flag_ = reason;
  }

  /// Where there is no ground: level, through the lowest points.
  Plane upright_ground() const {
    std::vector<double> down;
    for (const Eigen::Vector3d& p : surface_.points) down.push_back(p.y());
    return {{0.0, -1.0, 0.0}, take_quantile(down, 1.0 - kExtreme)};
  }

  /// Quantile of values over the pixels that a condition chooses; NaN without any.
  template <typename Value, typename Choice>
  double quantile(double share, const Value& value, const Choice& choice) const {
    std::vector<double> values;
    for (std::size_t i = 0; i < size(); ++i) {
      if (choice(i)) values.push_back(value(i));
    }
    return take_quantile(std::move(values), share);
  }

  /// Axes over the ground: right, ahead, up; heights and the lower band.
  void place() {
    const Eigen::Vector3d up = ground_.normal;
    Eigen::Vector3d right = up.cross(Eigen::Vector3d::UnitZ()).normalized();
    if (right.x() < 0.0) right = -right;
    Eigen::Vector3d ahead = right.cross(up);
    if (ahead.z() < 0.0) ahead = -ahead;
    axes_ << right.transpose(), ahead.transpose(), up.transpose();
    origin_ = ground_.foot(surface_.points.front());
    local_.resize(size());
    normal_.resize(size());
    for (std::size_t i = 0; i < size(); ++i) {
      local_[i] = axes_ * (surface_.points[i] - origin_);
      normal_[i] = axes_ * surface_.normals[i];
    }
    height_ = quantile(
        1.0 - kExtreme / 2, [&](std::size_t i) { return local_[i].z(); },
        [](std::size_t) { return true; });
    low_.resize(size());
    steep_.resize(size());
    for (std::size_t i = 0; i < size(); ++i) {
      low_[i] = local_[i].z() > kBandFrom && local_[i].z() < kBandTo * height_;
      steep_[i] = low_[i] && surface_.areas[i] > 0.0 && std::abs(normal_[i].z()) < kSteep;
    }
  }

  double direction(std::size_t i) const { return std::atan2(normal_[i].y(), normal_[i].x()); }

  /// The direction, modulo 90 degrees, that most of the steep surface agrees with.
  bool find_heading() {
    constexpr int kBins = 360;
    constexpr double kBin = 0.5 * kPi / kBins;
    const double largest = quantile(
        0.98, [&](std::size_t i) { return surface_.areas[i]; },
        [&](std::size_t i) { return steep_[i]; });
    if (std::isnan(largest)) return false;
    weight_.assign(size(), 0.0);
    std::array<double, kBins> histogram{};
    std::size_t count = 0;
    for (std::size_t i = 0; i < size(); ++i) {
      if (!steep_[i]) continue;
      ++count;
      weight_[i] = std::min(surface_.areas[i], largest);
      const double turned = quarter_difference(direction(i)) + 0.25 * kPi;
      histogram[std::clamp(static_cast<int>(turned / kBin), 0, kBins - 1)] += weight_[i];
    }
    if (count < kFewest) return false;
    double best = -1.0;
    for (int bin = 0; bin < kBins; ++bin) {
      double sum = 0.0;
      for (int d = -40; d <= 40; ++d) {
        const double r = d * kBin / kHeadingKernel;
        sum += std::exp(-0.5 * r * r) * histogram[(bin + d + kBins) % kBins];
      }
      if (sum <= best) continue;
      best = sum;
      heading_ = (bin + 0.5) * kBin - 0.25 * kPi;
    }
    for (int round = 0; round < 5; ++round) {
      double sum = 0.0, moment = 0.0;
      for (std::size_t i = 0; i < size(); ++i) {
        if (weight_[i] == 0.0) continue;
        const double d = quarter_difference(direction(i) - heading_);
        const double w = weight_[i] * std::exp(-0.5 * d * d / (kHeadingKernel * kHeadingKernel));
        sum += w;
        moment += w * d;
      }
      if (sum > 0.0) heading_ += moment / sum;
    }
    return true;
  }

  /// Coordinates of a pixel, or of a normal, along an axis that is turned by `angle`.
  static double along(const Eigen::Vector3d& v, double angle) {
    return v.x() * std::cos(angle) + v.y() * std::sin(angle);
  }

  /// Length of the flat face whose normals lie along `angle`, m; 0 for less than kFewest pixels.
  double face_length(double angle) const {
    const auto on_face = [&](std::size_t i) { return flat_on(i, angle); };
    std::size_t count = 0;
    for (std::size_t i = 0; i < size(); ++i) count += on_face(i) ? 1 : 0;
    if (count < kFewest) return 0.0;
    const auto place = [&](std::size_t i) { return along(local_[i], angle + 0.5 * kPi); };
    return quantile(0.99, place, on_face) - quantile(0.01, place, on_face);
  }
  bool flat_on(std::size_t i, double angle) const {
    if (!steep_[i] || std::abs(quarter_difference(direction(i) - angle)) >= kFlat) return false;
    return std::abs(std::cos(direction(i) - angle)) > 0.7;
  }

  /// Of the two faces the longer flat one is the side. Without one the vehicle is seen from its
  /// end, and the mean of its normals is the heading.
  bool find_side() {
    const double lengths[2] = {face_length(heading_), face_length(heading_ + 0.5 * kPi)};
    const int side = lengths[1] > lengths[0] ? 1 : 0;
    side_seen_ = lengths[side] >= kShortestSide;
    if (side_seen_) {
      along_ = heading_ + (side == 0 ? 0.5 * kPi : 0.0);
      return true;
    }
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (std::size_t i = 0; i < size(); ++i) sum += weight_[i] * normal_[i].head<2>();
    if (!(sum.norm() > 0.0)) return false;
    along_ = std::atan2(sum.y(), sum.x());
    return true;
  }

  /// Moves and pitches the ground so that the seen side's wheels stand on it.
  void stand_on_wheels() {
    const double across = along_ + 0.5 * kPi;
    const auto on_side = [&](std::size_t i) { return flat_on(i, across); };
    const double facing = quantile(
        0.5, [&](std::size_t i) { return along(normal_[i], across); }, on_side);
    const double sign = facing < 0.0 ? -1.0 : 1.0;
    const auto outward = [&](std::size_t i) { return sign * along(local_[i], across); };
    const double edge = quantile(0.9, outward, on_side) - 0.35;
    const auto place = [&](std::size_t i) { return along(local_[i], along_); };
    const auto all = [](std::size_t) { return true; };
    const double middle = 0.5 * (quantile(0.01, place, all) + quantile(0.99, place, all));
    std::vector<Eigen::Vector2d> contacts;  // along, height
    for (const bool rear : {true, false}) {
      std::size_t lowest = size();
      std::size_t count = 0;
      for (std::size_t i = 0; i < size(); ++i) {
        if (outward(i) <= edge || (place(i) < middle) != rear) continue;
        ++count;
        if (lowest == size() || local_[i].z() < local_[lowest].z()) lowest = i;
      }
      if (count < kFewest) continue;
      contacts.emplace_back(place(lowest), local_[lowest].z());
    }
    Eigen::Vector3d up = ground_.normal, foot = origin_;
    const Eigen::Vector3d forward = direction_in_camera(along_);
    if (contacts.size() == 2 && std::abs(contacts[0].y()) < kWheelCorrection &&
        std::abs(contacts[1].y()) < kWheelCorrection &&
        std::abs(contacts[1].x() - contacts[0].x()) > 1.2) {
      const double slope =
          (contacts[1].y() - contacts[0].y()) / (contacts[1].x() - contacts[0].x());
      foot += (contacts[0].y() - slope * contacts[0].x()) * up;
      up = (up - slope * forward).normalized();
    } else {
      double least = kWheelCorrection;
      for (const Eigen::Vector2d& contact : contacts) least = std::min(least, contact.y());
      if (std::abs(least) < kWheelCorrection) foot += least * up;
    }
    ground_ = Plane::through(foot, up);
  }

  Eigen::Vector3d direction_in_camera(double angle) const {
    return axes_.transpose() * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0.0);
  }

  /// x towards the end that is seen, y towards the side that is seen.
  void orient() {
    const double across = along_ + 0.5 * kPi;
    const Eigen::Vector3d camera = axes_ * -origin_;
    double ends = 0.0, sides = 0.0;
    for (std::size_t i = 0; i < size(); ++i) {
      const double u = along(normal_[i], along_), v = along(normal_[i], across);
      if (std::abs(u) > 0.8) ends += weight_[i] * u;
      if (flat_on(i, across)) sides += weight_[i] * v;
    }
    const auto place = [&](std::size_t i) { return along(local_[i], along_); };
    const auto all = [](std::size_t) { return true; };
    if (ends == 0.0) ends = along(camera, along_) - quantile(0.5, place, all);
    x_sign_ = ends < 0.0 ? -1.0 : 1.0;
    y_sign_ = sides < 0.0 ? -1.0 : 1.0;
    x_.resize(size());
    y_.resize(size());
    lean_.resize(size());
    for (std::size_t i = 0; i < size(); ++i) {
      x_[i] = x_sign_ * place(i);
      y_[i] = y_sign_ * along(local_[i], across);
      lean_[i] =
          std::atan2(y_sign_ * along(normal_[i], across), x_sign_ * along(normal_[i], along_));
    }
    camera_x_ = x_sign_ * along(camera, along_);
    camera_y_ = y_sign_ * along(camera, across);
  }

  /// Middle line and width by the end that is seen: its normals are symmetric about the middle.
  bool measure_width() {
    const auto on_end = [&](std::size_t i) {
      return steep_[i] && std::abs(lean_[i]) < kEndNormals && x_[i] > near_end_ - 1.0;
    };
    const double hidden = quantile(
        0.97, [&](std::size_t i) { return -lean_[i]; }, on_end);  // away from the side
    if (std::isnan(hidden)) return false;
    const double limit = std::clamp(hidden, 2.0 * kDegree, kMiddleNormals);
    const auto near_middle = [&](std::size_t i) { return on_end(i) && std::abs(lean_[i]) < limit; };
    const auto across = [&](std::size_t i) { return y_[i]; };
    const double from = quantile(0.01, across, near_middle),
                 to = quantile(0.99, across, near_middle);
    if (std::isnan(from)) return false;
    middle_ = 0.5 * (from + to);
    end_width_ = to - from;
    return true;
  }

  /// Where a place of the plan is seen, as an angle that grows towards the near end.
  double bearing(double x, double y) const { return std::atan2(camera_y_ - y, camera_x_ - x); }

  /// Length at which the near end's outline, mirrored, touches the silhouette at the far end.
  double measure_length(double seen) const {
    std::vector<std::pair<double, double>> outline;  // behind the near end, across
    std::vector<double> bearings;
    for (std::size_t i = 0; i < size(); ++i) {
      if (!low_[i]) continue;
      bearings.push_back(bearing(x_[i], y_[i]));
      if (y_[i] > middle_ && x_[i] > near_end_ - 1.2) {
        outline.emplace_back(near_end_ - x_[i], y_[i]);
      }
    }
    if (outline.size() < kFewest) return seen;
    const double silhouette = take_quantile(std::move(bearings), kExtreme);
    double shortest = seen, longest = seen + 1.2;
    for (int round = 0; round < 25; ++round) {
      const double length = 0.5 * (shortest + longest);
      std::vector<double> at;
      at.reserve(outline.size());
      for (const auto& [behind, across] : outline) {
        at.push_back(bearing(near_end_ - length + behind, across));
      }
      (take_quantile(std::move(at), kExtreme) > silhouette ? shortest : longest) = length;
    }
    return 0.5 * (shortest + longest);
  }

  void measure(const Dimensions& prior) {
    const auto low = [&](std::size_t i) { return static_cast<bool>(low_[i]); };
    const auto all = [](std::size_t) { return true; };
    const auto x = [&](std::size_t i) { return x_[i]; };
    const auto y = [&](std::size_t i) { return y_[i]; };
    near_end_ = quantile(1.0 - kExtreme, x, low);
    near_side_ = quantile(1.0 - kExtreme, y, low);
    const double seen = near_end_ - quantile(kExtreme, x, low);
    const bool end_seen = measure_width() && end_width_ >= kNarrowestEnd;
    size_ = {std::max(prior.length, near_end_ - quantile(kExtreme, x, all)), prior.width, height_};
    if (!side_seen_) {
      // From the end alone: what is seen of the width, and the length of its class.
      const double far_side = quantile(kExtreme, y, low);
      size_.width = near_side_ - far_side;
      middle_ = 0.5 * (near_side_ + far_side);
      flag(box_flags::kOneSide);
      return;
    }
    if (!end_seen) {
      middle_ = near_side_ - 0.5 * size_.width;
      flag(box_flags::kOneSide);
      return;
    }
    // A flat end shows its whole width, a round one not.
    size_.width = std::max(2.0 * (near_side_ - middle_), near_side_ - quantile(kExtreme, y, low));
    middle_ = near_side_ - 0.5 * size_.width;
    size_.length = measure_length(seen);
    if (std::atan2(camera_y_ - near_side_, camera_x_ - near_end_ + 0.5 * size_.length) <
        kGrazingSide) {
      size_.length = std::max(size_.length, prior.length);
      flag(box_flags::kOneSide);
    }
  }

  void judge_silhouette() {
    const SilhouetteEnds ends = silhouette_ends(region_, *image_.depth, low_);
    if (std::max(ends.cut_left, ends.cut_right) >= kHiddenEdge) {
      flag_ = box_flags::kTruncated;
    } else if (std::max(ends.hidden_left, ends.hidden_right) >= kHiddenEdge ||
               !(quantile(
                     kExtreme, [&](std::size_t i) { return local_[i].z(); },
                     [&](std::size_t i) { return y_[i] > near_side_ - 0.4; }) < kWheelsSeen)) {
      if (flag_.empty() || flag_ == box_flags::kOneSide) flag_ = box_flags::kOccluded;
    }
  }

  /// Whether the end that is seen is the front: behind a bonnet the roof begins later.
  bool sees_front() {
    constexpr int kParts = 20;
    double begins = 1.0;
    for (int part = 0; part < kParts; ++part) {
      const double from = near_end_ - size_.length * part / kParts,
                   to = near_end_ - size_.length * (part + 1) / kParts;
      const double top = quantile(
          0.98, [&](std::size_t i) { return local_[i].z(); },
          [&](std::size_t i) { return x_[i] <= from && x_[i] > to; });
      if (!(top > kRoof * height_)) continue;
      begins = static_cast<double>(part) / kParts;
      break;
    }
    if (begins > kTailRoof - 1e-9 && begins < kBonnetRoof) flag(box_flags::kDirection);
    return begins >= 0.5 * (kTailRoof + kBonnetRoof);
  }

  TruthVehicle vehicle(const std::string& vehicle_class) {
    const bool front = sees_front();
    const bool box_shaped = vehicle_class == "bus" || vehicle_class == "truck";
    if (box_shaped) flag(box_flags::kDirection);
    const double x = x_sign_ * (near_end_ - 0.5 * size_.length), y = y_sign_ * middle_;
    const Eigen::Vector3d along_axis = direction_in_camera(along_),
                          across_axis = direction_in_camera(along_ + 0.5 * kPi);
    const Eigen::Vector3d up = ground_.normal, forward = (front ? x_sign_ : -x_sign_) * along_axis;
    Eigen::Matrix3d rotation;
    rotation << forward, up, forward.cross(up);
    TruthVehicle out;
    out.vehicle_class = vehicle_class;
    out.pose.camera_from_vehicle = SE3(rotation, origin_ + x * along_axis + y * across_axis);
    out.pose.dimensions = size_;
    out.plane = ground_;
    out.box = box_of(region_, image_.depth->width);
    out.truncation = projected_truncation(out.pose, camera_);
    out.occlusion = hidden_share(region_, out.pose, image_, camera_);
    out.uncertain = flag_;
    const auto projected = projected_box(out.pose, camera_);
    if (projected && (out.occlusion > kHiddenEdge || flag_ == box_flags::kTruncated)) {
      out.box = *projected;
    }
    return out;
  }

  const VehicleRegion& region_;
  const LabelledDepth& image_;
  const PinholeCamera& camera_;
  const DepthSurface surface_;
  Plane ground_;
  Eigen::Matrix3d axes_;    // rows right, ahead, up; plan from camera
  Eigen::Vector3d origin_;  // on the ground
  std::vector<Eigen::Vector3d> local_, normal_;
  std::vector<bool> low_, steep_;
  std::vector<double> weight_;
  double heading_ = 0.0, along_ = 0.0;  // rad in plan: of a face's normal; of the vehicle's axis
  bool side_seen_ = false;
  double x_sign_ = 1.0, y_sign_ = 1.0, camera_x_ = 0.0, camera_y_ = 0.0;
  std::vector<double> x_, y_, lean_;  // lean: of the normal from the seen end's to the seen side's
  double height_ = 0.0, near_end_ = 0.0, near_side_ = 0.0, middle_ = 0.0, end_width_ = 0.0;
  Dimensions size_;
  std::string flag_;
};

}  // namespace

std::optional<TruthVehicle> fit_vehicle_to_depth(const VehicleRegion& region,
                                                 const LabelledDepth& image,
                                                 const PinholeCamera& camera,
                                                 const std::string& vehicle_class) {
  return VehicleFit(region, image, camera).run(vehicle_class);
}

}  // namespace camber
