#include "camber/photometric/refine_ground.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "camber/core/threads.h"
#include "camber/photometric/photometric_image.h"

namespace camber {
namespace {

struct Sample {
  float value, dx, dy;
};

Sample bilinear(const PhotometricImage& image, float x, float y) {
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const std::size_t at = static_cast<std::size_t>(y0) * static_cast<std::size_t>(image.value.width) +
                         static_cast<std::size_t>(x0);
  const std::size_t below = at + static_cast<std::size_t>(image.value.width);
  const float w00 = (1 - ax) * (1 - ay), w01 = ax * (1 - ay), w10 = (1 - ax) * ay, w11 = ax * ay;
  const auto mix = [&](const std::vector<float>& p) {
    return w00 * p[at] + w01 * p[at + 1] + w10 * p[below] + w11 * p[below + 1];
  };
  return {mix(image.value.pixels), mix(image.gradient_x.pixels), mix(image.gradient_y.pixels)};
}

double robust_sigma(std::vector<float>& absolute) {
  if (absolute.empty()) return 0.0;
  const auto middle = absolute.begin() + static_cast<std::ptrdiff_t>(absolute.size() / 2);
  std::nth_element(absolute.begin(), middle, absolute.end());
  return 1.4826 * *middle;
}

}  // namespace

void RefineGroundOptions::validate() const {
  if (levels.empty()) throw std::invalid_argument("levels is empty, expected at least one");
  for (const Level& level : levels) {
    if (!(level.blur_px >= 0.3) || level.step < 1 || level.iterations < 1) {
      throw std::invalid_argument("a level has blur_px " + std::to_string(level.blur_px) +
                                  ", step " + std::to_string(level.step) + ", iterations " +
                                  std::to_string(level.iterations) +
                                  "; expected at least 0.3, 1, 1");
    }
  }
}

RefineGroundReport refine_ground(const PinholeCamera& camera, const std::vector<GrayImage>& images,
                                 int reference, const std::vector<std::uint8_t>& ground,
                                 const std::vector<std::vector<std::uint8_t>>& blocked,
                                 const std::vector<SE3>& frame_from_reference, GroundField& field,
                                 const RefineGroundOptions& options) {
  options.validate();
  const auto width = static_cast<std::size_t>(camera.width);
  RefineGroundReport report;
  struct Row {
    std::vector<Eigen::Vector2d> pixels;
    std::vector<double> inverse_depth, sigma;
    std::vector<float> residuals;
  };
  const int top = std::max(1, static_cast<int>(std::ceil(field.top() + 1.0)));

  double grey_sigma = 0.3;
  for (std::size_t l = 0; l < options.levels.size(); ++l) {
    const RefineGroundOptions::Level& level = options.levels[l];
    std::vector<PhotometricImage> pictures(images.size());
    parallel_for(images.size(), options.num_threads, [&](std::size_t k) {
      pictures[k] = make_photometric_image(images[k], level.blur_px, options.window_px);
    });
    const PhotometricImage& base = pictures[static_cast<std::size_t>(reference)];
    const int step = level.step;
    const int rows = (camera.height - 1 - top) / step;
    if (rows < 1) return report;

    for (int iteration = 0; iteration < level.iterations; ++iteration) {
      std::vector<Row> collected(static_cast<std::size_t>(rows));
      parallel_for(static_cast<std::size_t>(rows), options.num_threads, [&](std::size_t r) {
        Row& out = collected[r];
        const int v = top + static_cast<int>(r) * step;
        for (int u = 1 + (v / step % 2) * (step / 2); u < camera.width - 1; u += step) {
          const std::size_t at = static_cast<std::size_t>(v) * width + static_cast<std::size_t>(u);
          if (!ground[at]) continue;
          const Eigen::Vector2d pixel(u, v);
          const double rho = field.inverse_depth(pixel);
          if (!(rho > 0)) continue;
          const Eigen::Vector3d ray = camera.ray(pixel);
          const float here = base.value.pixels[at];
          double information = 0.0, right = 0.0;
          for (std::size_t k = 0; k < images.size(); ++k) {
            if (static_cast<int>(k) == reference) continue;
            const SE3& pose = frame_from_reference[k];
            const Eigen::Vector3d t = pose.translation();
            const Eigen::Vector3d p = pose.rotation() * ray + rho * t;
            if (!(p.z() > 1e-3)) continue;
            const double x = camera.fx * p.x() / p.z() + camera.cx;
            const double y = camera.fy * p.y() / p.z() + camera.cy;
            if (!(x >= 1 && y >= 1 && x < camera.width - 2 && y < camera.height - 2)) continue;
            if (!blocked[k].empty() &&
                blocked[k][static_cast<std::size_t>(std::lround(y)) * width +
                           static_cast<std::size_t>(std::lround(x))]) {
              continue;
            }
            const Sample s = bilinear(pictures[k], static_cast<float>(x), static_cast<float>(y));
            const double du = camera.fx * (t.x() - p.x() / p.z() * t.z()) / p.z();
            const double dv = camera.fy * (t.y() - p.y() / p.z() * t.z()) / p.z();
            if (rho * std::hypot(du, dv) < options.min_shift_px) continue;
            const double residual = s.value - here;
            // Mean of both images' gradients: the step of efficient second-order minimisation
            // (Malis, ICRA 2004), here without turning the reference's gradient.
            const double j = s.dx * du + s.dy * dv;
            const double scale = options.match_sigma_px * std::hypot(s.dx, s.dy);
            const double variance = grey_sigma * grey_sigma + scale * scale;
            const double w = 1.0 / (variance * (1.0 + residual * residual / (4.0 * variance)));
            information += w * j * j;
            right += w * j * residual;
            out.residuals.push_back(static_cast<float>(std::abs(residual)));
          }
          if (!(information > 1e-12)) continue;
          out.pixels.push_back(pixel);
          out.inverse_depth.push_back(rho - right / information);
          out.sigma.push_back(1.0 / std::sqrt(information));
        }
      });
      GroundObservations observations;
      std::vector<float> residuals;
      for (const Row& row : collected) {
        observations.pixels.insert(observations.pixels.end(), row.pixels.begin(), row.pixels.end());
        observations.inverse_depth.insert(observations.inverse_depth.end(),
                                          row.inverse_depth.begin(), row.inverse_depth.end());
        observations.sigma.insert(observations.sigma.end(), row.sigma.begin(), row.sigma.end());
        residuals.insert(residuals.end(), row.residuals.begin(), row.residuals.end());
      }
      if (observations.size() < 100) return report;
      report.samples = static_cast<long>(residuals.size());
      grey_sigma = std::max(0.02, robust_sigma(residuals));
      if (l + 1 == options.levels.size()) {
        if (iteration == 0) report.residual_before = grey_sigma;
        report.residual_after = grey_sigma;
      }
      field.update(observations, 2);
    }
  }
  return report;
}

}  // namespace camber
