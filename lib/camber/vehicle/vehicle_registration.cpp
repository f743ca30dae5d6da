#include "camber/vehicle/vehicle_registration.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace camber {

namespace {

constexpr double kFine = 0.8;  // px, blur of the last level
constexpr int kMost = 2500;    // pixels that enter
constexpr int kFewest = 40;
// Neighbouring residuals share the blur: 4 pi sigma^2 pixels say what one says.
constexpr double kCorrelated = 8.0;
// What each image shows of the body otherwise than the others do (sampling, reflections): px of its
// place, and px of its growth at the outline. By the true motions of 84 registrations beyond 15 m
// in rendered scenes: 0.05 to 0.12 and 0.10 to 0.16, robustly, with longer tails.
constexpr double kOwnError = 0.1;
constexpr double kOwnGrowth = 0.12;
constexpr double kGrowthShare = 0.05;  // of the growth: neighbouring pixels of unlike depth
constexpr double kBodyDepth = 0.15;    // m, of the body off its hull
constexpr double kLeastCorrelation = 0.9;

/// Planes of a convex hull: n . x <= d inside.
struct HalfSpace {
  Eigen::Vector3d normal;
  double offset;
};

std::vector<HalfSpace> convex_hull(const std::array<Eigen::Vector3d, kNumKeypoints>& points) {
  std::vector<HalfSpace> out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = i + 1; j < points.size(); ++j) {
      for (std::size_t k = j + 1; k < points.size(); ++k) {
        Eigen::Vector3d n = (points[j] - points[i]).cross(points[k] - points[i]);
        const double length = n.norm();
        if (!(length > 1e-4)) continue;
        n /= length;
        const double d = n.dot(points[i]);
        bool below = true, above = true;
        for (std::size_t m = 0; m < points.size() && (below || above); ++m) {
          const double e = n.dot(points[m]) - d;
          below &= e < 1e-6;
          above &= e > -1e-6;
        }
        if (!below && !above) continue;
        const HalfSpace face = below ? HalfSpace{n, d} : HalfSpace{-n, -d};
        const bool known = std::any_of(out.begin(), out.end(), [&](const HalfSpace& other) {
          return (other.normal - face.normal).squaredNorm() < 1e-10;
        });
        if (!known) out.push_back(face);
      }
    }
  }
  return out;
}

/// Depth z at which the ray (z = 1) enters the hull; 0: it does not.
double hull_depth(const std::vector<HalfSpace>& hull, const Eigen::Vector3d& ray) {
  double enter = 0.0, leave = 1e9;
  for (const HalfSpace& h : hull) {
    const double along = h.normal.dot(ray);
    if (along < -1e-9) {
      enter = std::max(enter, h.offset / along);
    } else if (along > 1e-9) {
      leave = std::min(leave, h.offset / along);
    } else if (h.offset < 0.0) {
      return 0.0;
    }
  }
  return enter > 0.1 && enter < leave ? enter : 0.0;
}

/// A blurred part of an image.
struct Crop {
  int x0 = 0, y0 = 0, width = 0, height = 0;
  std::vector<float> values;

  bool contains(const Eigen::Vector2d& p) const {
    return p.x() >= x0 + 1 && p.y() >= y0 + 1 && p.x() < x0 + width - 2 && p.y() < y0 + height - 2;
  }
  float at(int x, int y) const {
    return values[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)];
  }
  double value(const Eigen::Vector2d& p) const {
    const double x = p.x() - x0, y = p.y() - y0;
    const int i = static_cast<int>(x), j = static_cast<int>(y);
    const double a = x - i, b = y - j;
    return (1 - b) * ((1 - a) * at(i, j) + a * at(i + 1, j)) +
           b * ((1 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
  }
};

Crop blurred(const GrayImage& image, const Box2& box, double sigma) {
  const int reach = static_cast<int>(std::ceil(3.0 * sigma));
  Crop out;
  out.x0 = std::max(0, static_cast<int>(box.x1));
  out.y0 = std::max(0, static_cast<int>(box.y1));
  out.width = std::min(image.width, static_cast<int>(box.x2) + 1) - out.x0;
  out.height = std::min(image.height, static_cast<int>(box.y2) + 1) - out.y0;
  if (out.width <= 0 || out.height <= 0) return Crop{};
  std::vector<float> kernel(static_cast<std::size_t>(2 * reach + 1));
  float total = 0.0F;
  for (int i = -reach; i <= reach; ++i) {
    kernel[static_cast<std::size_t>(i + reach)] =
        static_cast<float>(std::exp(-0.5 * i * i / (sigma * sigma)));
    total += kernel[static_cast<std::size_t>(i + reach)];
  }
  for (float& k : kernel) k /= total;
  const int rows = out.height + 2 * reach;
  const auto width = static_cast<std::size_t>(out.width);
  std::vector<float> across(width * static_cast<std::size_t>(rows));
  for (int y = 0; y < rows; ++y) {
    const std::uint8_t* row = image.row(std::clamp(out.y0 + y - reach, 0, image.height - 1));
    for (int x = 0; x < out.width; ++x) {
      float sum = 0.0F;
      for (int i = -reach; i <= reach; ++i) {
        sum += kernel[static_cast<std::size_t>(i + reach)] *
               static_cast<float>(row[std::clamp(out.x0 + x + i, 0, image.width - 1)]);
      }
      across[static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)] = sum;
    }
  }
  out.values.assign(width * static_cast<std::size_t>(out.height), 0.0F);
  for (int y = 0; y < out.height; ++y) {
    for (int i = 0; i <= 2 * reach; ++i) {
      const float k = kernel[static_cast<std::size_t>(i)];
      const float* from = &across[static_cast<std::size_t>(y + i) * width];
      float* to = &out.values[static_cast<std::size_t>(y) * width];
      for (std::size_t x = 0; x < width; ++x) to[x] += k * from[x];
    }
  }
  return out;
}

/// Median by selection; reorders.
double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

std::optional<VehicleTemplate> VehicleTemplate::cut(
    const PinholeCamera& camera, const GrayImage& image, const VehicleEstimate& vehicle,
    const std::vector<const VehicleEstimate*>& nearer) {
  Box2 box{1e9, 1e9, -1e9, -1e9};
  for (const Eigen::Vector3d& x : vehicle.keypoints) {
    const auto p = camera.project(x);
    if (!p || !(x.z() > 0.5)) return std::nullopt;
    box = {std::min(box.x1, p->x()), std::min(box.y1, p->y()), std::max(box.x2, p->x()),
           std::max(box.y2, p->y())};
  }
  const Box2 inside = box.clipped(camera.width, camera.height);
  if (!(inside.area() > kFewest)) return std::nullopt;
  VehicleTemplate out;
  out.camera_ = camera;
  out.step_ = std::max(1.0, std::round(std::sqrt(inside.area() / kMost)));
  const std::vector<HalfSpace> hull = convex_hull(vehicle.keypoints);
  std::vector<std::vector<HalfSpace>> hiding;
  for (const VehicleEstimate* other : nearer) {
    if (intersection_over_union(other->box, box) > 0.0) {
      hiding.push_back(convex_hull(other->keypoints));
    }
  }

  // Depths on a grid; 0: not the vehicle, negative: something hides it.
  const int step = static_cast<int>(out.step_);
  const int u0 = static_cast<int>(std::floor(inside.x1)) - step;
  const int v0 = static_cast<int>(std::floor(inside.y1)) - step;
  const int columns = static_cast<int>(inside.width()) / step + 4;
  const int rows = static_cast<int>(inside.height()) / step + 4;
  std::vector<double> depths(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  const auto at = [&](int i, int j) -> double& {
    return depths[static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) +
                  static_cast<std::size_t>(i)];
  };
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const Eigen::Vector3d ray = camera.ray({u0 + i * step, v0 + j * step});
      at(i, j) = hull_depth(hull, ray);
      for (const auto& other : hiding) {
        if (hull_depth(other, ray) > 0.0) at(i, j) = -1.0;
      }
    }
  }
  // Off the outlines, whose places are known to a pixel or two.
  const auto cells = [&](double px) {
    return std::max(1, static_cast<int>(std::lround(px / step)));
  };
  const int inner = cells(std::clamp(0.03 * box.width(), 1.0, 3.0)), outer = cells(3.0);
  const auto clear = [&](int i, int j) {
    const auto value = [&](int a, int b) {
      return a < 0 || b < 0 || a >= columns || b >= rows ? 0.0 : at(a, b);
    };
    if (!(value(i, j) > 0.0) || !(value(i - inner, j) > 0.0) || !(value(i + inner, j) > 0.0) ||
        !(value(i, j - inner) > 0.0) || !(value(i, j + inner) > 0.0)) {
      return false;
    }
    if (hiding.empty()) return true;
    for (int b = j - outer; b <= j + outer; ++b) {
      for (int a = i - outer; a <= i + outer; ++a) {
        if (value(a, b) < 0.0) return false;
      }
    }
    return true;
  };
  std::vector<Eigen::Vector2d> places;
  std::vector<double> own;
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const Eigen::Vector2d p(u0 + i * step, v0 + j * step);
      if (!camera.contains(p, 2.0) || !clear(i, j)) continue;
      places.push_back(p);
      own.push_back(at(i, j));
      middle += p;
    }
  }
  if (places.size() < kFewest) return std::nullopt;
  middle /= static_cast<double>(places.size());
  std::size_t anchor = 0;  // the pixel nearest to the middle
  double spread = 0.0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    spread += (places[i] - middle).squaredNorm() / static_cast<double>(places.size());
    if ((places[i] - middle).squaredNorm() < (places[anchor] - middle).squaredNorm()) anchor = i;
  }
  out.anchor_ = places[anchor];
  out.depth_ = own[anchor];
  out.extent_ = std::sqrt(spread);
  out.coarse_ = std::clamp(out.extent_ / 8.0, 1.2, 4.0);
  const Box2 around = box.grown(4.0);
  const Crop coarse = blurred(image, around, out.coarse_), fine = blurred(image, around, kFine);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!fine.contains(places[i])) continue;
    out.pixels_.push_back({camera.ray(places[i]), out.depth_ / own[i], coarse.value(places[i]),
                           fine.value(places[i])});
  }
  if (out.pixels_.size() < kFewest) return std::nullopt;
  return out;
}

std::optional<VehicleShift> VehicleTemplate::find_in(const GrayImage& second,
                                                     const SE3& second_from_first) const {
  const Eigen::Matrix3d rotation = second_from_first.rotation_matrix();
  Eigen::Vector3d theta = second_from_first.translation() / depth_;
  const double cx = camera_.cx, cy = camera_.cy, fx = camera_.fx, fy = camera_.fy;
  std::vector<Eigen::Vector3d> rays;
  rays.reserve(pixels_.size());
  Box2 there{1e9, 1e9, -1e9, -1e9};
  for (const Pixel& p : pixels_) {
    rays.emplace_back(rotation * p.ray);
    const Eigen::Vector3d y = rays.back() + p.inverse_depth * theta;
    if (!(y.z() > 0.05)) return std::nullopt;
    const double u = fx * y.x() / y.z() + cx, v = fy * y.y() / y.z() + cy;
    there = {std::min(there.x1, u), std::min(there.y1, v), std::max(there.x2, u),
             std::max(there.y2, v)};
  }
  struct Sample {
    double here, now;
    Eigen::Vector3d gradient;
  };
  std::vector<Sample> samples;
  std::vector<double> absolute;
  samples.reserve(pixels_.size());
  absolute.reserve(pixels_.size());
  Eigen::Matrix3d left = Eigen::Matrix3d::Zero();
  double noise = 0.0, correlation = 0.0;
  for (const double sigma : {coarse_, kFine}) {
    const bool last = sigma == kFine;
    const Crop crop = blurred(second, there.grown(6.0 + 4.0 * sigma), sigma);
    if (crop.values.empty()) return std::nullopt;
    const Eigen::Vector2d du(1.0, 0.0), dv(0.0, 1.0);
    for (int iteration = 0; iteration < 12; ++iteration) {
      samples.clear();
      for (std::size_t i = 0; i < pixels_.size(); ++i) {
        const Pixel& p = pixels_[i];
        const Eigen::Vector3d y = rays[i] + p.inverse_depth * theta;
        if (!(y.z() > 0.05)) return std::nullopt;
        const double iz = 1.0 / y.z();
        const Eigen::Vector2d q(fx * y.x() * iz + cx, fy * y.y() * iz + cy);
        if (!crop.contains(q) || !camera_.contains(q, 2.0)) continue;
        const double gu = 0.5 * fx * (crop.value(q + du) - crop.value(q - du));
        const double gv = 0.5 * fy * (crop.value(q + dv) - crop.value(q - dv));
        samples.push_back(
            {last ? p.fine : p.coarse, crop.value(q),
             p.inverse_depth * iz * Eigen::Vector3d(gu, gv, -iz * (gu * y.x() + gv * y.y()))});
      }
      const auto n = static_cast<double>(samples.size());
      if (samples.size() < kFewest || n < 0.5 * static_cast<double>(pixels_.size())) {
        return std::nullopt;
      }
      // Gain and offset by moments, then with the rest.
      double ma = 0.0, mb = 0.0, aa = 0.0, ab = 0.0, bb = 0.0;
      for (const Sample& s : samples) {
        ma += s.here / n;
        mb += s.now / n;
      }
      for (const Sample& s : samples) {
        aa += (s.here - ma) * (s.here - ma);
        ab += (s.here - ma) * (s.now - mb);
        bb += (s.now - mb) * (s.now - mb);
      }
      if (!(aa > n) || !(bb > n)) return std::nullopt;  // less than a grey value of contrast
      correlation = ab / std::sqrt(aa * bb);
      const double gain = std::sqrt(bb / aa);
      absolute.clear();
      for (const Sample& s : samples) {
        absolute.push_back(std::abs(s.now - mb - gain * (s.here - ma)));
      }
      const double scale = std::max(1.4826 * median(absolute), 0.5);
      Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
      Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
      double squares = 0.0, weights = 0.0;
      for (const Sample& s : samples) {
        const double r = s.now - mb - gain * (s.here - ma);
        const double t = r / (3.0 * scale);
        const double w = 1.0 / (1.0 + t * t);
        Eigen::Matrix<double, 5, 1> j;
        j << s.gradient, -(s.here - ma), -1.0;
        normal += w * j * j.transpose();
        right -= w * r * j;
        squares += w * r * r;
        weights += w;
      }
      const Eigen::LDLT<Eigen::Matrix<double, 5, 5>> factors(normal);
      if (factors.info() != Eigen::Success || !factors.isPositive()) return std::nullopt;
      const Eigen::Matrix<double, 5, 1> move = factors.solve(right);
      if (!move.allFinite()) return std::nullopt;
      // Not farther than the blur at once.
      const double far = std::max(fx * move.head<2>().norm(), extent_ * std::abs(move[2]));
      theta += move.head<3>() * std::min(1.0, 1.5 * sigma / std::max(far, 1e-12));
      noise = squares / std::max(weights - 5.0, 1.0);
      left = factors.solve(Eigen::Matrix<double, 5, 5>::Identity()).topLeftCorner<3, 3>();
      if (far < (last ? 0.01 : 0.1)) break;
    }
  }
  if (!(correlation > kLeastCorrelation)) return std::nullopt;

  VehicleShift out;
  const Eigen::Vector3d y = rotation * camera_.ray(anchor_) + theta;
  if (!(y.z() > 0.05)) return std::nullopt;
  out.anchor = depth_ * camera_.ray(anchor_);
  out.displacement = Eigen::Vector2d(fx * y.x() / y.z() + cx, fy * y.y() / y.z() + cy) - anchor_;
  out.log_depth_ratio = std::log(y.z());
  out.correlation = correlation;
  Eigen::Matrix3d j;
  j << fx / y.z(), 0.0, -fx * y.x() / (y.z() * y.z()), 0.0, fy / y.z(),
      -fy * y.y() / (y.z() * y.z()), 0.0, 0.0, 1.0 / y.z();
  const Eigen::Vector3d own = Eigen::Vector3d(kOwnError, kOwnError, kOwnGrowth / extent_);
  out.shared = own.cwiseAbs2().asDiagonal();
  out.noise =
      std::max(1.0, kCorrelated / (step_ * step_)) * noise * j * left * j.transpose() + out.shared;
  out.noise(2, 2) += std::pow(kGrowthShare * out.log_depth_ratio, 2);
  out.by_depth = j * theta;
  out.depth_sigma = kBodyDepth / depth_;
  return out;
}

}  // namespace camber
