#include "camber/vehicle/detail/vehicle_registration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "camber/core/median.h"
#include "camber/vehicle/detail/convex_hull.h"
#include "camber/vehicle/detail/pixel_bounds.h"
#include "camber/vehicle/detail/projection.h"

namespace camber::internal {

namespace {

constexpr double kFineBlur = 0.8;  // px, of the last level
constexpr int kMostPixels = 2500;  // that enter
constexpr int kFewestPixels = 40;
constexpr std::size_t kMostHiding = 16;  // behind more others' boxes a vehicle is not looked for
constexpr double kLeastDepth = 0.05;     // over the anchor's

/// Depths of a vehicle's hull on a grid of pixels; 0: not the vehicle, or by the mask none,
/// negative: another one hides it.
class DepthGrid {
 public:
  DepthGrid(const PinholeCamera& camera, const Box2& inside, int step,
            const std::vector<HalfSpace>& hull, std::vector<std::vector<HalfSpace>> hiding,
            const std::vector<std::uint8_t>* vehicle_mask)
      : u0_(static_cast<int>(std::floor(inside.x1)) - step),
        v0_(static_cast<int>(std::floor(inside.y1)) - step),
        step_(step),
        columns_(static_cast<int>(inside.width()) / step + 4),
        rows_(static_cast<int>(inside.height()) / step + 4),
        hidden_(!hiding.empty()) {
    depths_.reserve(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
    for (int j = 0; j < rows_; ++j) {
      for (int i = 0; i < columns_; ++i) {
        if (vehicle_mask && !shows(*vehicle_mask, camera, pixel(i, j))) {
          depths_.push_back(0.0);
          continue;
        }
        const Eigen::Vector3d ray = camera.ray(pixel(i, j));
        double depth = hull_depth(hull, ray);
        for (const auto& other : hiding) {
          if (!(hull_depth(other, ray) > 0.0)) continue;
          depth = -1.0;
          break;
        }
        depths_.push_back(depth);
      }
    }
  }

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  Eigen::Vector2d pixel(int i, int j) const { return {u0_ + i * step_, v0_ + j * step_}; }
  double at(int i, int j) const {
    if (i < 0 || j < 0 || i >= columns_ || j >= rows_) return 0.0;
    return depths_[static_cast<std::size_t>(j) * static_cast<std::size_t>(columns_) +
                   static_cast<std::size_t>(i)];
  }
  /// At least `inner` px inside the vehicle's outline and `outer` px off those of others.
  bool clear(int i, int j, double inner, double outer) const {
    const int a = cells(inner), b = cells(outer);
    if (!(at(i, j) > 0.0) || !(at(i - a, j) > 0.0) || !(at(i + a, j) > 0.0) ||
        !(at(i, j - a) > 0.0) || !(at(i, j + a) > 0.0)) {
      return false;
    }
    if (!hidden_) return true;
    for (int y = j - b; y <= j + b; ++y) {
      for (int x = i - b; x <= i + b; ++x) {
        if (at(x, y) < 0.0) return false;
      }
    }
    return true;
  }

 private:
  /// Pixels beyond the image are taken for the vehicle's.
  static bool shows(const std::vector<std::uint8_t>& mask, const PinholeCamera& camera,
                    const Eigen::Vector2d& pixel) {
    const int u = static_cast<int>(pixel.x()), v = static_cast<int>(pixel.y());
    if (u < 0 || v < 0 || u >= camera.width || v >= camera.height) return true;
    return mask[static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width) +
                static_cast<std::size_t>(u)] != 0;
  }

  int cells(double px) const { return std::max(1, static_cast<int>(std::lround(px / step_))); }

  int u0_, v0_, step_, columns_, rows_;
  bool hidden_;
  std::vector<double> depths_;
};

}  // namespace

std::optional<VehicleTemplate> VehicleTemplate::cut(
    const PinholeCamera& camera, const GrayImage& image, const VehicleEstimate& vehicle,
    const std::vector<const VehicleEstimate*>& nearer, const RegistrationNoise& noise,
    const std::vector<std::uint8_t>* vehicle_mask) {
  PixelBounds bounds;
  for (const Eigen::Vector3d& x : vehicle.keypoints) {
    const auto p = camera.project(x);
    if (!p || !(x.z() > 0.5)) return std::nullopt;
    bounds.include(*p);
  }
  const Box2& box = bounds.box;
  const Box2 inside = box.clipped(camera.width, camera.height);
  if (!(inside.area() > kFewestPixels)) return std::nullopt;
  VehicleTemplate out;
  out.camera_ = camera;
  out.noise_ = noise;
  out.step_ = std::max(1.0, std::round(std::sqrt(inside.area() / kMostPixels)));
  std::vector<const VehicleEstimate*> before;
  for (const VehicleEstimate* other : nearer) {
    if (intersection_over_union(other->box, box) > 0.0) before.push_back(other);
  }
  if (before.size() > kMostHiding) return std::nullopt;
  std::vector<std::vector<HalfSpace>> hiding;
  for (const VehicleEstimate* other : before) hiding.push_back(convex_hull(other->keypoints));
  const DepthGrid grid(camera, inside, static_cast<int>(out.step_), convex_hull(vehicle.keypoints),
                       std::move(hiding), vehicle_mask);

  // Off the outlines, whose places are known to a pixel or two.
  const double inner = std::clamp(0.03 * box.width(), 1.0, 3.0), outer = 3.0;  // px
  std::vector<Eigen::Vector2d> places;
  std::vector<double> depths;
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (int j = 0; j < grid.rows(); ++j) {
    for (int i = 0; i < grid.columns(); ++i) {
      const Eigen::Vector2d p = grid.pixel(i, j);
      if (!camera.contains(p, 2.0) || !grid.clear(i, j, inner, outer)) continue;
      places.push_back(p);
      depths.push_back(grid.at(i, j));
      middle += p;
    }
  }
  if (places.size() < kFewestPixels) return std::nullopt;
  middle /= static_cast<double>(places.size());
  std::size_t anchor = 0;  // the pixel nearest to the middle
  double spread = 0.0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    spread += (places[i] - middle).squaredNorm() / static_cast<double>(places.size());
    if ((places[i] - middle).squaredNorm() < (places[anchor] - middle).squaredNorm()) anchor = i;
  }
  out.anchor_ = places[anchor];
  out.depth_ = depths[anchor];
  out.extent_ = std::sqrt(spread);
  out.coarse_ = std::clamp(out.extent_ / 8.0, 1.2, 4.0);
  const Box2 around = box.grown(4.0);
  const BlurredCrop coarse = blurred_crop(image, around, out.coarse_);
  const BlurredCrop fine = blurred_crop(image, around, kFineBlur);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!fine.contains(places[i])) continue;
    out.pixels_.push_back({camera.ray(places[i]), out.depth_ / depths[i], coarse.value(places[i]),
                           fine.value(places[i])});
  }
  if (out.pixels_.size() < kFewestPixels) return std::nullopt;
  return out;
}

/// State of the iteration.
struct VehicleTemplate::Alignment {
  struct Sample {
    double here, now;  // intensities
    Eigen::Vector3d gradient;
  };
  std::vector<Eigen::Vector3d> rays;  // of the pixels, turned into the second camera
  Eigen::Vector3d theta;              // translation over the anchor's depth
  std::vector<Sample> samples;
  std::vector<double> absolute;                       // residuals; a member for its memory
  Eigen::Matrix3d inverse = Eigen::Matrix3d::Zero();  // of the normal matrix, part of theta
  double noise = 0.0;                                 // variance of an intensity's residual
  double correlation = 0.0;
  double moved_px = 0.0;  // by the last step
};

bool VehicleTemplate::sample(const BlurredCrop& crop, bool fine, Alignment* alignment) const {
  const Eigen::Vector2d du(1.0, 0.0), dv(0.0, 1.0);
  alignment->samples.clear();
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const Pixel& p = pixels_[i];
    const Eigen::Vector3d y = alignment->rays[i] + p.inverse_depth * alignment->theta;
    if (!(y.z() > kLeastDepth)) return false;
    const Eigen::Vector2d q = *camera_.project(y);
    if (!crop.contains(q) || !camera_.contains(q, 2.0)) continue;
    const Eigen::Matrix3d by_y = projection_jacobian(camera_, y);
    const double gu = 0.5 * (crop.value(q + du) - crop.value(q - du));
    const double gv = 0.5 * (crop.value(q + dv) - crop.value(q - dv));
    const Eigen::Vector3d gradient = gu * by_y.row(0) + gv * by_y.row(1);
    alignment->samples.push_back(
        {fine ? p.fine : p.coarse, crop.value(q), p.inverse_depth * gradient});
  }
  return true;
}

bool VehicleTemplate::improve(double blur, Alignment* alignment) const {
  const std::vector<Alignment::Sample>& samples = alignment->samples;
  const auto n = static_cast<double>(samples.size());
  if (samples.size() < kFewestPixels || n < 0.5 * static_cast<double>(pixels_.size())) return false;
  // Gain and offset by moments, then with the rest.
  double ma = 0.0, mb = 0.0, aa = 0.0, ab = 0.0, bb = 0.0;
  for (const auto& s : samples) {
    ma += s.here / n;
    mb += s.now / n;
  }
  for (const auto& s : samples) {
    aa += (s.here - ma) * (s.here - ma);
    ab += (s.here - ma) * (s.now - mb);
    bb += (s.now - mb) * (s.now - mb);
  }
  if (!(aa > n) || !(bb > n)) return false;  // less than an intensity level of contrast
  alignment->correlation = ab / std::sqrt(aa * bb);
  const double gain = std::sqrt(bb / aa);
  std::vector<double>& absolute = alignment->absolute;
  absolute.clear();
  for (const auto& s : samples) absolute.push_back(std::abs(s.now - mb - gain * (s.here - ma)));
  const double scale = std::max(kSigmaFromMad * upper_median(&absolute), 0.5);
  Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
  Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
  double squares = 0.0, weights = 0.0;
  for (const auto& s : samples) {
    const double r = s.now - mb - gain * (s.here - ma);
    const double t = r / (noise_.outlier_scale * scale);
    const double w = 1.0 / (1.0 + t * t);
    Eigen::Matrix<double, 5, 1> j;
    j << s.gradient, -(s.here - ma), -1.0;
    normal += w * j * j.transpose();
    right -= w * r * j;
    squares += w * r * r;
    weights += w;
  }
  const Eigen::LDLT<Eigen::Matrix<double, 5, 5>> factors(normal);
  if (factors.info() != Eigen::Success || !factors.isPositive()) return false;
  const Eigen::Matrix<double, 5, 1> move = factors.solve(right);
  if (!move.allFinite()) return false;
  // Not farther than the blur at once.
  const double far = std::max(camera_.fx * move.head<2>().norm(), extent_ * std::abs(move[2]));
  alignment->theta += move.head<3>() * std::min(1.0, 1.5 * blur / std::max(far, 1e-12));
  alignment->noise = squares / std::max(weights - 5.0, 1.0);
  alignment->inverse = factors.solve(Eigen::Matrix<double, 5, 5>::Identity()).topLeftCorner<3, 3>();
  alignment->moved_px = far;
  return true;
}

std::optional<VehicleShift> VehicleTemplate::find_in(const GrayImage& second,
                                                     const SE3& second_from_first) const {
  constexpr int kIterations = 12;
  const Eigen::Matrix3d rotation = second_from_first.rotation_matrix();
  Alignment alignment;
  alignment.theta = second_from_first.translation() / depth_;
  alignment.rays.reserve(pixels_.size());
  PixelBounds there;
  for (const Pixel& p : pixels_) {
    alignment.rays.emplace_back(rotation * p.ray);
    const Eigen::Vector3d y = alignment.rays.back() + p.inverse_depth * alignment.theta;
    if (!(y.z() > kLeastDepth)) return std::nullopt;
    there.include(*camera_.project(y));
  }
  for (const double blur : {coarse_, kFineBlur}) {
    const bool last = blur == kFineBlur;
    const BlurredCrop crop = blurred_crop(second, there.box.grown(6.0 + 4.0 * blur), blur);
    if (crop.values.empty()) return std::nullopt;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      if (!sample(crop, last, &alignment) || !improve(blur, &alignment)) return std::nullopt;
      if (alignment.moved_px < (last ? 0.01 : 0.1)) break;
    }
  }
  if (!(alignment.correlation > noise_.min_correlation)) return std::nullopt;
  const Eigen::Vector3d y = rotation * camera_.ray(anchor_) + alignment.theta;
  if (!(y.z() > kLeastDepth)) return std::nullopt;
  return shift(alignment, y);
}

VehicleShift VehicleTemplate::shift(const Alignment& alignment, const Eigen::Vector3d& y) const {
  VehicleShift out;
  out.anchor = depth_ * camera_.ray(anchor_);
  out.displacement = *camera_.project(y) - anchor_;
  out.log_depth_ratio = std::log(y.z());
  out.correlation = alignment.correlation;
  const Eigen::Matrix3d j = projection_jacobian(camera_, y);
  const double growth = noise_.growth_px / extent_;
  out.shared = Eigen::Vector3d(noise_.place_px, noise_.place_px, growth).cwiseAbs2().asDiagonal();
  out.noise = std::max(1.0, noise_.correlated_pixels / (step_ * step_)) * alignment.noise * j *
                  alignment.inverse * j.transpose() +
              out.shared;
  out.noise(2, 2) += std::pow(noise_.growth_share * out.log_depth_ratio, 2);
  out.by_depth = j * alignment.theta;
  out.depth_sigma = noise_.body_depth / depth_;
  return out;
}

}  // namespace camber::internal
