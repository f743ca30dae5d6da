#include "camber/plane/noise_model.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace camber {
namespace {

std::uint32_t leading_bits(float sigma) {
  std::uint32_t bits;
  std::memcpy(&bits, &sigma, sizeof(bits));
  return bits >> 16;  // sign, exponent, 7 bits of the fraction: steps of less than 1 %
}

bool usable(float sigma) { return sigma > 1e-12f && sigma < 1e12f; }

}  // namespace

bool any_usable_sigma(const std::vector<float>& sigmas) {
  return std::any_of(sigmas.begin(), sigmas.end(), usable);
}

void NoiseModel::tabulate(double low, double high) {
  first = leading_bits(static_cast<float>(std::clamp(low, 1e-12, 1e12)));
  const std::uint32_t last = leading_bits(static_cast<float>(std::clamp(high, 1e-12, 1e12)));
  table.resize(last - first + 1);
  for (std::uint32_t i = 0; i < table.size(); ++i) {
    const std::uint32_t bits = ((first + i) << 16) | 0x8000u;
    float sigma;
    std::memcpy(&sigma, &bits, sizeof(sigma));
    const double deviation = scale * std::pow(static_cast<double>(sigma), exponent);
    table[i] = static_cast<float>(1.0 / (deviation * deviation));
  }
}

void NoiseModel::rescale(double factor) {
  scale *= factor;
  least *= factor;
  const float divisor = static_cast<float>(factor * factor);
  for (float& weight : table) weight /= divisor;
}

void NoiseModel::weigh(const Eigen::Vector3d& normal, double offset, std::size_t n, const float* x,
                       const float* y, const float* z, const float* sigma,
                       const std::array<float, 6>* covariance, float* w) const {
  weigh_without_least(normal, offset, n, x, y, z, sigma, covariance, w);
  if (!(least > 0.0)) return;
  const float most = static_cast<float>(1.0 / (least * least));
  for (std::size_t i = 0; i < n; ++i) w[i] = std::min(w[i], most);
}

void NoiseModel::weigh_without_least(const Eigen::Vector3d& normal, double offset, std::size_t n,
                                     const float* x, const float* y, const float* z,
                                     const float* sigma, const std::array<float, 6>* covariance,
                                     float* w) const {
  const float factor = static_cast<float>(1.0 / (scale * scale));
  switch (kind) {
    case NoiseKind::kSame:
      for (std::size_t i = 0; i < n; ++i) w[i] = w[i] > 0.0f ? factor : 0.0f;
      return;
    case NoiseKind::kIsotropic:
      for (std::size_t i = 0; i < n; ++i) {
        w[i] = w[i] > 0.0f && usable(sigma[i]) ? factor / (sigma[i] * sigma[i]) : 0.0f;
      }
      return;
    case NoiseKind::kPower: {
      const std::uint32_t last = first + static_cast<std::uint32_t>(table.size()) - 1;
      for (std::size_t i = 0; i < n; ++i) {
        const bool good = w[i] > 0.0f && usable(sigma[i]);
        w[i] = good ? table[std::clamp(leading_bits(sigma[i]), first, last) - first] : 0.0f;
      }
      return;
    }
    case NoiseKind::kRays: {
      // A point at range s on a ray that meets the plane at the grazing angle asin(h / s), h the
      // viewpoint's distance from the plane, has the deviation sigma h / s along the normal. h / s
      // is taken at the measured range: with sigma growing as s^2 this is the linear model in 1 /
      // s, whose weights do not depend on the noise.
      const float vx = static_cast<float>(viewpoint.x()), vy = static_cast<float>(viewpoint.y()),
                  vz = static_cast<float>(viewpoint.z());
      const double height = normal.dot(viewpoint) + offset;
      const float view2 = static_cast<float>(height * height);
      constexpr float kFloor2 = static_cast<float>(kGrazingFloor * kGrazingFloor);
      for (std::size_t i = 0; i < n; ++i) {
        const float dx = x[i] - vx, dy = y[i] - vy, dz = z[i] - vz;
        const float s2 = dx * dx + dy * dy + dz * dz;
        const bool good = w[i] > 0.0f && usable(sigma[i]) && s2 > 0.0f;
        w[i] = good ? factor * s2 / (sigma[i] * sigma[i] * (view2 + kFloor2 * s2)) : 0.0f;
      }
      return;
    }
    case NoiseKind::kCovariance: {
      const float nx = static_cast<float>(normal.x()), ny = static_cast<float>(normal.y()),
                  nz = static_cast<float>(normal.z());
      for (std::size_t i = 0; i < n; ++i) {
        const std::array<float, 6>& c = covariance[i];
        const float variance = nx * nx * c[0] + ny * ny * c[3] + nz * nz * c[5] +
                               2.0f * (nx * ny * c[1] + nx * nz * c[2] + ny * nz * c[4]);
        w[i] = w[i] > 0.0f && variance > 1e-24f && variance < 1e24f ? factor / variance : 0.0f;
      }
      return;
    }
  }
}

double quantile(std::vector<float>& values, double share) {
  const std::size_t k = std::min(
      values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())));
  std::nth_element(values.begin(), values.begin() + static_cast<long>(k), values.end());
  return values[k];
}

double core_deviation(const float* residuals, std::size_t n, double start, double reach) {
  constexpr std::size_t kBins = 96;
  // The last bin holds what lies beyond. Two histograms: neighbours often fall into one bin.
  std::array<std::uint32_t, kBins + 1> bins[2] = {};
  const double width = reach / kBins;
  const float per_width = static_cast<float>(1.0 / width), end = static_cast<float>(kBins);
  for (std::size_t i = 0; i < n; ++i) {
    const float place = std::abs(residuals[i]) * per_width;
    ++bins[i % 2][static_cast<std::uint32_t>(place < end ? place : end)];
  }
  std::array<double, kBins> counts{};
  double total = 0.0;
  for (std::size_t k = 0; k < kBins; ++k) {
    counts[k] = static_cast<double>(bins[0][k] + bins[1][k]);
    total += counts[k];
  }
  if (total < 20.0) return start;
  double deviation = start, share = 0.8;
  for (int iteration = 0; iteration < 60; ++iteration) {
    double in = 0.0, squares = 0.0;
    // exp(-a^2 / 2 s^2) at a = (k + 1/2) width, from bin to bin.
    const double unit = width / deviation;
    double bell = share * std::sqrt(2.0 / M_PI) / deviation * std::exp(-0.125 * unit * unit);
    double ratio = std::exp(-unit * unit);
    const double next_ratio = ratio;
    for (std::size_t k = 0; k < kBins; ++k) {
      const double a = (static_cast<double>(k) + 0.5) * width;
      const double p = bell / (bell + (1.0 - share) / reach) * counts[k];
      in += p;
      squares += p * a * a;
      bell *= ratio;
      ratio *= next_ratio;
    }
    if (!(in > 0.0)) return start;
    const double next = std::sqrt(std::max(squares / in, width * width / 12.0));
    const double next_share = std::clamp(in / total, 0.05, 0.999);
    // Both: the deviation alone may stand still for a step on its way.
    const bool settled =
        std::abs(next - deviation) < 1e-5 * deviation && std::abs(next_share - share) < 1e-5;
    deviation = next;
    share = next_share;
    if (settled) break;
  }
  return deviation;
}

bool learn_power_law(std::vector<std::pair<float, float>>& pairs, double typical, double least,
                     NoiseModel* model) {
  constexpr std::size_t kGroups = 6;
  constexpr double kMedianOfNormal = 0.6745;  // median of |N(0, 1)|
  if (pairs.size() < kGroups * 40) return false;
  std::sort(pairs.begin(), pairs.end());
  std::vector<Eigen::Vector2d> knots;  // log sigma, log deviation; groups of equal size
  for (std::size_t g = 0; g < kGroups; ++g) {
    const std::size_t begin = pairs.size() * g / kGroups, end = pairs.size() * (g + 1) / kGroups;
    std::vector<float> sizes;
    for (std::size_t k = begin; k < end; ++k) {
      if (pairs[k].second < 8.0 * typical) sizes.push_back(pairs[k].second);
    }
    if (sizes.size() < 20) continue;
    const double deviation = std::max(quantile(sizes, 0.5) / kMedianOfNormal, least);
    knots.emplace_back(std::log(static_cast<double>(pairs[(begin + end) / 2].first)),
                       std::log(deviation));
  }
  if (knots.size() < 2) return false;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& knot : knots) mean += knot / static_cast<double>(knots.size());
  double xx = 0.0, xy = 0.0;
  for (const Eigen::Vector2d& knot : knots) {
    xx += (knot.x() - mean.x()) * (knot.x() - mean.x());
    xy += (knot.x() - mean.x()) * (knot.y() - mean.y());
  }
  model->kind = NoiseKind::kPower;
  model->exponent = xx > 1e-4 ? std::clamp(xy / xx, 0.0, 1.5) : 1.0;
  model->scale = std::exp(mean.y() - model->exponent * mean.x());
  model->tabulate(static_cast<double>(pairs.front().first) / 8.0,
                  static_cast<double>(pairs.back().first) * 8.0);
  return true;
}

}  // namespace camber
