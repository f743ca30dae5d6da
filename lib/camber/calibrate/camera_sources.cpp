#include "camber/calibrate/camera_sources.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "camber/scale/scale_noise.h"

namespace camber {
namespace {

constexpr double kGate = 3.0;  // standard deviations

Eigen::Vector2d row_of(const CameraSource& s) { return {s.by_focal, s.by_height}; }

struct Information {
  Eigen::Matrix2d matrix = Eigen::Matrix2d::Zero();
  Eigen::Vector2d vector = Eigen::Vector2d::Zero();

  void add(const CameraSource& s) {
    const double weight = 1.0 / (s.sigma * s.sigma);
    matrix += weight * row_of(s) * row_of(s).transpose();
    vector += weight * s.value * row_of(s);
  }
};

Information information_of(const std::vector<CameraSource>& sources,
                           const std::function<bool(std::size_t)>& counts) {
  Information out;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    if (counts(i)) out.add(sources[i]);
  }
  return out;
}

/// What the others let a source measure.
struct Expected {
  double value = 0.0, variance = 0.0;
  bool open() const { return !(variance < 1.0); }
};

Expected expected_by(const Information& others, const CameraSource& source) {
  constexpr double kNothing = 1e-6;
  const Eigen::Matrix2d covariance =
      (others.matrix + kNothing * Eigen::Matrix2d::Identity()).inverse();
  const Eigen::Vector2d row = row_of(source);
  return {row.dot(covariance * others.vector), row.dot(covariance * row)};
}

}  // namespace

double CameraJoint::focal_sigma() const { return std::sqrt(covariance(0, 0)); }
double CameraJoint::height_sigma() const { return std::sqrt(covariance(1, 1)); }

CameraSource height_of_cars() {
  const ScaleNoise noise;
  CameraSource out;
  out.name = "height_of_cars";
  out.phrase = "what is usual for cars to vans";
  out.by_height = 1.0;
  out.value = std::log(noise.unknown_camera_height);
  out.sigma = out.common = noise.unknown_camera_height_sigma / noise.unknown_camera_height;
  return out;
}

CameraJoint join_sources(std::vector<CameraSource>* sources) {
  std::vector<CameraSource>& all = *sources;
  for (CameraSource& s : all) {
    if (!(s.sigma > 0.0) || !std::isfinite(s.value)) {
      throw std::invalid_argument(
          fmt::format("{}: {} +- {}, must be finite and > 0", s.name, s.value, s.sigma));
    }
    s.accepted = true;
    s.reason.clear();
  }
  const auto residual = [&](std::size_t i) {
    const Information others =
        information_of(all, [&](std::size_t j) { return j != i && all[j].accepted; });
    const Expected expected = expected_by(others, all[i]);
    if (expected.open()) return std::numeric_limits<double>::quiet_NaN();
    return (all[i].value - expected.value) /
           std::sqrt(all[i].sigma * all[i].sigma + expected.variance);
  };
  std::vector<std::size_t> unresolved;
  while (true) {
    std::size_t worst = all.size();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!all[i].accepted) continue;
      all[i].residual_sigma = residual(i);
      constexpr double kAlike = 1e-6;
      const double off = std::abs(all[i].residual_sigma);
      if (off > kGate &&
          (worst == all.size() || off > std::abs(all[worst].residual_sigma) * (1.0 - kAlike))) {
        worst = i;
      }
    }
    if (worst == all.size()) break;
    all[worst].accepted = false;
    all[worst].reason = fmt::format("{:.1f} standard deviations off the other sources",
                                    std::abs(all[worst].residual_sigma));
    unresolved.push_back(worst);
  }
  const Information joint = information_of(all, [&](std::size_t i) { return all[i].accepted; });
  if (!(std::abs(joint.matrix.determinant()) > 1e-9)) {
    throw std::invalid_argument("the sources leave the focal length or the height open");
  }
  CameraJoint out;
  out.covariance = joint.matrix.inverse();
  out.value = out.covariance * joint.vector;
  for (const std::size_t i : unresolved) {
    const Eigen::Vector2d row = row_of(all[i]);
    const double variance = row.dot(out.covariance * row);
    const double difference = all[i].value - row.dot(out.value);
    // Known well enough to show the difference, whichever accepted source is left out?
    double second = 0.0;
    for (std::size_t k = 0; k < all.size(); ++k) {
      if (!all[k].accepted) continue;
      const Information rest =
          information_of(all, [&](std::size_t j) { return j != k && all[j].accepted; });
      second = std::max(second, expected_by(rest, all[i]).variance);
    }
    if (second < difference * difference / (kGate * kGate)) continue;
    const double squared = difference * difference / (all[i].sigma * all[i].sigma + variance);
    if (!(squared > 1.0)) continue;
    // Of what it measures: the unknowns take part in it as they are known.
    const Eigen::Vector2d along = out.covariance * row / variance;
    out.covariance += (squared - 1.0) * variance * along * along.transpose();
  }
  return out;
}

double share_of_source(const std::vector<CameraSource>& sources, std::size_t source, int unknown) {
  if (!sources.at(source).accepted) return 0.0;
  constexpr double kNothing = 1e-6;
  const auto variance = [&](bool with) {
    Information information = information_of(
        sources, [&](std::size_t i) { return sources[i].accepted && (with || i != source); });
    information.matrix += kNothing * Eigen::Matrix2d::Identity();
    return information.matrix.inverse()(unknown, unknown);
  };
  return 1.0 - variance(true) / variance(false);
}

}  // namespace camber
