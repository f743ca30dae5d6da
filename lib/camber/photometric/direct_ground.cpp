#include "camber/photometric/direct_ground.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>

#include "camber/core/median.h"
#include "camber/core/threads.h"
#include "camber/image/detail/cubic_sampling.h"
#include "camber/photometric/detail/direct_kernels.h"

namespace camber {
namespace {

/// Cells of pixels that only judge; fixed, so that before and after are compared on the same.
bool is_held_out(int u, int v, double share) {
  auto h = static_cast<std::uint32_t>(u / 12) * 0x9E3779B1u ^
           static_cast<std::uint32_t>(v / 4) * 0x85EBCA77u;
  h ^= h >> 15;
  h *= 0x2C1B3C6Du;
  h ^= h >> 13;
  return (h & 0xFFFFu) < static_cast<std::uint32_t>(share * 65536.0);
}

constexpr double kMostCost = 9.0;  // of a pixel: one off by more than 3 sigma costs no more

double robust_cost(double r) { return std::min(r * r, kMostCost); }

constexpr int kWindowWide = 21, kWindowHigh = 13;  // px, of the local mean and contrast
constexpr int kPatchWide = 9, kPatchHigh = 5;      // px, of what disagrees as a whole
constexpr float kPatchPixels = kPatchWide * kPatchHigh;
constexpr float kMostExcess = 3.0F;  // mean over a patch, in variances: more contradicts the ground
constexpr float kJudgedPatch = 0.3F;  // valid share of a patch that may contradict it
constexpr float kWholePatch = 0.98F;  // valid share of a patch away from the rim and other things
constexpr double kLeastArea = 0.2, kMostArea = 5.0;    // of a pixel seen in the other image, px^2
constexpr double kLeastSignal = 0.03;                  // inverse depth over its standard deviation
constexpr float kSharpness = -0.5F;                    // of cubic sampling: planes stay planes
constexpr double kMiddle = 128.0;                      // taken off so that sums stay exact
constexpr double kFinalBlur = 0.7, kCoarseBlur = 1.5;  // px

/// Pixel values, rows without gaps; not set where they are made without a value.
class Plane32 {
 public:
  Plane32(int width, int rows) : values_(rows, width, CV_32F) {}
  Plane32(int width, int rows, float value) : values_(rows, width, CV_32F, cv::Scalar(value)) {}
  float* row(int y) { return values_.ptr<float>(y); }
  const float* row(int y) const { return values_.ptr<float>(y); }
  int width() const { return values_.cols; }
  int rows() const { return values_.rows; }

 private:
  cv::Mat values_;
};

using Spans = std::vector<ColumnSpan>;  // one a row

/// Spans that hold those of the rows around, and pixels beside them.
Spans grown(const Spans& spans, int side, int rows_around, int width) {
  const int rows = static_cast<int>(spans.size());
  Spans out(spans.size());
  for (int y = 0; y < rows; ++y) {
    ColumnSpan& to = out[static_cast<std::size_t>(y)];
    to = {width, 0};
    for (int v = std::max(0, y - rows_around); v <= std::min(rows - 1, y + rows_around); ++v) {
      const ColumnSpan& from = spans[static_cast<std::size_t>(v)];
      if (from.count() <= 0) continue;
      to.from = std::min(to.from, std::max(0, from.from - side));
      to.to = std::max(to.to, std::min(width, from.to + side));
    }
    if (to.count() <= 0) to = {};
  }
  return out;
}

/// Local mean and contrast taken out, over the valid pixels of a window.
/// @param weight  number of valid pixels in the window.
Plane32 normalised(const Plane32& intensity, const Plane32& valid, const Plane32& weight,
                   const Spans& spans, double least_contrast) {
  const int width = intensity.width(), rows = intensity.rows();
  Plane32 out(width, rows, 0.0F), sum(width, rows), squares(width, rows);
  for (int y = 0; y < rows; ++y) {
    const float* from = intensity.row(y);
    const float* ok = valid.row(y);
    float* to = out.row(y);
    const ColumnSpan span = spans[static_cast<std::size_t>(y)];
    for (int x = span.from; x < span.to; ++x) to[x] = from[x] * ok[x];
  }
  window_sums(width, spans, out.row(0), kWindowWide, kWindowHigh, sum.row(0), squares.row(0));
  for (int y = 0; y < rows; ++y) {
    const ColumnSpan span = spans[static_cast<std::size_t>(y)];
    normalise_row(span.count(), intensity.row(y) + span.from, weight.row(y) + span.from,
                  sum.row(y) + span.from, squares.row(y) + span.from,
                  static_cast<float>(least_contrast), out.row(y) + span.from);
  }
  return out;
}

/// What one image measures of the ground at one linearisation.
struct ImageRows {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<double> inverse_depth, sigma;
  std::vector<Eigen::Matrix<float, 6, 1>> by_pose;
  std::vector<HeldOutPixels::Pixel> judged;
  double noise = 0.0;
  cv::Mat contradicted;  // bytes, rows of the region

  void reserve(std::size_t count) {
    pixels.reserve(count);
    inverse_depth.reserve(count);
    sigma.reserve(count);
    by_pose.reserve(count);
  }

  /// A pixel's residual, to first order, as an observation of its inverse depth and of the pose.
  /// @param by_point  derivative of the residual by ray + rho * translation
  void observe(const Eigen::Vector2d& pixel, double rho, double residual, double residual_sigma,
               const Eigen::RowVector3d& by_point, const Eigen::Vector3d& ray,
               const Eigen::Vector3d& translation) {
    const double by_depth = by_point.dot(translation);
    // One pixel alone that knows less than a factor of 30 adds nothing but time.
    if (!(std::abs(by_depth) * rho > kLeastSignal * residual_sigma)) return;
    pixels.push_back(pixel);
    inverse_depth.push_back(rho - residual / by_depth);
    sigma.push_back(residual_sigma / std::abs(by_depth));
    Eigen::Matrix<float, 6, 1> pose_row;
    const Eigen::RowVector3d turned = by_point.cross(ray.transpose()) * -1.0;  // * -skew(ray)
    pose_row.head<3>() = (-turned / by_depth).transpose().cast<float>();
    pose_row.tail<3>() = (-by_point * rho / by_depth).transpose().cast<float>();
    by_pose.push_back(pose_row);
  }
};

/// The reference image below its first row of interest.
struct Region {
  int first = 0, rows = 0;
  cv::Mat intensity;  // float
  cv::Mat ground;     // float, 0 or 1
  cv::Mat held_out;   // bytes, 1 for pixels that only judge
  Spans compared;     // ground, and what its derivatives look at
  Spans blurred;      // that and what its blur looks at

  /// Only where the ground lies pixels are looked at.
  void find_spans() {
    Spans ground_spans(static_cast<std::size_t>(rows));
    for (int y = 0; y < rows; ++y) {
      const float* row = ground.ptr<float>(y);
      ColumnSpan& span = ground_spans[static_cast<std::size_t>(y)];
      while (span.from < ground.cols && row[span.from] == 0.0F) ++span.from;
      span.to = ground.cols;
      while (span.to > span.from && row[span.to - 1] == 0.0F) --span.to;
    }
    compared = grown(ground_spans, 2, 2, ground.cols);
    const int reach = blur_reach(std::max(kFinalBlur, kCoarseBlur));
    blurred = grown(compared, reach, reach, ground.cols);
  }
};

Plane32 blurred(int width, const Spans& spans, const float* intensity, double blur) {
  Plane32 out(width, static_cast<int>(spans.size()));
  blur_plane(width, spans, intensity, blur, out.row(0));
  return out;
}

/// Where the region is seen in another image, in its spans.
struct WarpedRegion {
  Plane32 x, y;   // px; kNotWarped outside
  Plane32 valid;  // 1 where ground is seen in both images, else 0
};

WarpedRegion warped(const PinholeCamera& camera, const Region& ref,
                    const std::vector<float>& inverse_depth,
                    const std::vector<std::uint8_t>* ignored, const SE3& pose) {
  const int width = camera.width, rows = ref.rows;
  WarpedRegion out{{width, rows}, {width, rows}, {width, rows, 0.0F}};
  const Eigen::Matrix3d rotation = pose.rotation_matrix();
  const Eigen::Vector3f shift = pose.translation().cast<float>();
  const Eigen::Vector3f step = (rotation.col(0) / camera.fx).cast<float>();
  for (int y = 0; y < rows; ++y) {
    const auto [from, to] = ref.blurred[static_cast<std::size_t>(y)];
    const Eigen::Vector3f start =
        (rotation * camera.ray(Eigen::Vector2d(from, y + ref.first))).cast<float>();
    const RowWarp warp{start.x(),
                       start.y(),
                       start.z(),
                       step.x(),
                       step.y(),
                       step.z(),
                       shift.x(),
                       shift.y(),
                       shift.z(),
                       static_cast<float>(camera.fx),
                       static_cast<float>(camera.fy),
                       static_cast<float>(camera.cx),
                       static_cast<float>(camera.cy)};
    float* u = out.x.row(y);
    float* v = out.y.row(y);
    float* ok = out.valid.row(y);
    warp_row(to - from, inverse_depth.data() + static_cast<std::ptrdiff_t>(y) * width + from, warp,
             static_cast<float>(width - 2), static_cast<float>(camera.height - 2),
             {u + from, v + from, ok + from});
    const float* ground = ref.ground.ptr<float>(y);
    for (int x = from; x < to; ++x) {
      ok[x] *= ground[x];
      if (ok[x] == 0.0F || !ignored) continue;
      const auto at = static_cast<std::size_t>(v[x] + 0.5F) * static_cast<std::size_t>(width) +
                      static_cast<std::size_t>(u[x] + 0.5F);
      if ((*ignored)[at]) ok[x] = 0.0F;
    }
  }
  return out;
}

/// Robust standard deviation of the residuals of valid pixels, one in six of them; none for too
/// few.
std::optional<double> residual_noise(const Plane32& residual, const Plane32& valid,
                                     const Spans& spans) {
  std::vector<float> sizes;
  for (int y = 0; y < residual.rows(); y += 2) {
    const float* e = residual.row(y);
    const float* ok = valid.row(y);
    const ColumnSpan span = spans[static_cast<std::size_t>(y)];
    const int phase = y & 2 ? 1 : 0;
    for (int x = span.from + (phase + 3 - span.from % 3) % 3; x < span.to; x += 3) {
      if (ok[x] != 0.0f) sizes.push_back(std::abs(e[x]));
    }
  }
  if (sizes.size() < 100) return std::nullopt;
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return kSigmaFromMad * *middle + 1e-3;
}

/// The other image as it is seen in the region's spans.
Plane32 warped_image(const Region& ref, const WarpedRegion& map, const cv::Mat& other) {
  Plane32 out(map.x.width(), ref.rows);
  const detail::FloatImage seen{other.ptr<float>(), static_cast<std::ptrdiff_t>(other.step1()),
                                other.cols, other.rows};
  for (int y = 0; y < ref.rows; ++y) {
    const auto [from, to] = ref.blurred[static_cast<std::size_t>(y)];
    // Beyond the other image its rim goes on, for the blur beside it.
    const float* outside = ref.intensity.ptr<float>(y);
    if (y > 0 && to > from) {
      const ColumnSpan above = ref.blurred[static_cast<std::size_t>(y - 1)];
      float* row = out.row(y - 1);
      for (int x = from; x < to; ++x) {
        if (x < above.from || x >= above.to) row[x] = outside[x];
      }
      outside = row;
    }
    detail::sample_cubic(seen, kSharpness, to - from, map.x.row(y) + from, map.y.row(y) + from,
                         outside + from, out.row(y) + from);
  }
  return out;
}

/// Residuals, the other image less the reference, and the gradient of the two images' mean.
struct Residuals {
  Plane32 value, by_x, by_y;
};

Residuals residuals(const Plane32& reference, const Plane32& other, const Spans& spans) {
  const int width = reference.width(), rows = reference.rows();
  Residuals out{{width, rows}, {width, rows}, {width, rows}};
  for (int y = 0; y < rows; ++y) {
    const auto [from, to] = spans[static_cast<std::size_t>(y)];
    if (to <= from) continue;
    float* e = out.value.row(y);
    for (int x = from; x < to; ++x) e[x] = other.row(y)[x] - reference.row(y)[x];
    const int above = std::max(0, y - 1), below = std::min(rows - 1, y + 1);
    const float* of_a[3] = {reference.row(above) + from, reference.row(y) + from,
                            reference.row(below) + from};
    const float* of_b[3] = {other.row(above) + from, other.row(y) + from, other.row(below) + from};
    for (const int x : {from, to - 1}) {
      out.by_x.row(y)[x] = out.by_y.row(y)[x] = 0.0F;  // not looked at
    }
    gradient_row(to - from, of_a, of_b, out.by_x.row(y) + from, out.by_y.row(y) + from);
  }
  return out;
}

/// Sums over the patch around every pixel.
struct PatchSums {
  Plane32 excess;  // see excess_row()
  Plane32 pixels;  // valid ones
};

/// What disagrees with the noise over a whole neighbourhood; what is still to be mended is no
/// reason to leave a pixel out.
PatchSums patch_sums(const Residuals& residual, const Plane32& valid, const Spans& spans,
                     double noise_variance, double mended_px) {
  const int width = valid.width(), rows = valid.rows();
  Plane32 excess(width, rows, 0.0F);
  for (int y = 0; y < rows; ++y) {
    const auto [from, to] = spans[static_cast<std::size_t>(y)];
    excess_row(to - from, residual.value.row(y) + from, residual.by_x.row(y) + from,
               residual.by_y.row(y) + from, valid.row(y) + from, static_cast<float>(noise_variance),
               static_cast<float>(mended_px), excess.row(y) + from);
  }
  PatchSums out{{width, rows}, {width, rows}};
  window_sums(width, spans, excess.row(0), kPatchWide, kPatchHigh, out.excess.row(0), nullptr);
  window_sums(width, spans, valid.row(0), kPatchWide, kPatchHigh, out.pixels.row(0), nullptr);
  return out;
}

/// Derivative of where a pixel is seen in the other image.
/// @param u, v  three rows of the map, from above.
Eigen::Matrix2d map_jacobian(const float* const u[3], const float* const v[3], int x) {
  Eigen::Matrix2d out;
  out << 0.5 * (u[1][x + 1] - u[1][x - 1]), 0.5 * (u[2][x] - u[0][x]),
      0.5 * (v[1][x + 1] - v[1][x - 1]), 0.5 * (v[2][x] - v[0][x]);
  return out;
}

Eigen::Matrix<double, 2, 3> projection_jacobian(const PinholeCamera& camera,
                                                const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 2, 3> out;
  out << camera.fx / p.z(), 0, -camera.fx * p.x() / (p.z() * p.z()), 0, camera.fy / p.z(),
      -camera.fy * p.y() / (p.z() * p.z());
  return out;
}

/// Each pixel's residual as an observation of its inverse depth, or as a judgement; marks pixels
/// that contradict the ground.
/// @param near  inverse depth beyond which one pixel in four is enough
void observe_pixels(const PinholeCamera& camera, const Region& ref, const WarpedRegion& map,
                    const Residuals& residual, const PatchSums& patch,
                    const std::vector<float>& inverse_depth, double near, const SE3& pose,
                    const IntensityNoise& noise, bool only_judge, ImageRows* out) {
  const int width = camera.width, rows = ref.rows;
  const Eigen::Matrix3d rotation = pose.rotation_matrix();
  const Eigen::Vector3d t = pose.translation();
  const double n2 = out->noise * out->noise;
  const double d2 = noise.misregistration_px * noise.misregistration_px;
  for (int y = 2; y + 2 < rows; ++y) {
    const float* e = residual.value.row(y);
    const float* dx = residual.by_x.row(y);
    const float* dy = residual.by_y.row(y);
    const float* excess = patch.excess.row(y);
    const float* valid = patch.pixels.row(y);
    const float* const u[3] = {map.x.row(y - 1), map.x.row(y), map.x.row(y + 1)};
    const float* const v[3] = {map.y.row(y - 1), map.y.row(y), map.y.row(y + 1)};
    std::uint8_t* contradicted = out->contradicted.ptr<std::uint8_t>(y);
    const auto* held_out = ref.held_out.ptr<std::uint8_t>(y);
    const ColumnSpan span = ref.compared[static_cast<std::size_t>(y)];
    for (int x = std::max(2, span.from); x < std::min(width - 2, span.to); ++x) {
      const bool contradicts = excess[x] > kMostExcess * valid[x];
      if (valid[x] > kJudgedPatch * kPatchPixels && contradicts) contradicted[x] = 1;
      // Near something else or the rim, or contradicted.
      if (valid[x] < kWholePatch * kPatchPixels || contradicts) continue;
      const bool judge = held_out[x] != 0;
      if (only_judge && !judge) continue;
      const double rho =
          inverse_depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                        static_cast<std::size_t>(x)];
      if (!judge && rho > near && ((x | y) & 1)) continue;
      const double g2 = dx[x] * dx[x] + dy[x] * dy[x];
      const double sigma = std::sqrt(n2 + d2 * g2);
      if (judge) {
        out->judged.push_back({static_cast<float>(x), static_cast<float>(y + ref.first),
                               static_cast<float>(robust_cost(e[x] / sigma))});
        continue;
      }
      // A shift in the other image, seen in the reference: the inverse of the map's derivative.
      const Eigen::Matrix2d by_pixel = map_jacobian(u, v, x);
      const double determinant = by_pixel.determinant();
      if (!(determinant > kLeastArea && determinant < kMostArea)) continue;
      const Eigen::RowVector2d g = Eigen::RowVector2d(dx[x], dy[x]) * by_pixel.inverse();
      const Eigen::Vector3d ray = rotation * camera.ray(Eigen::Vector2d(x, y + ref.first));
      const Eigen::RowVector3d by_point = g * projection_jacobian(camera, ray + rho * t);
      out->observe({x, y + ref.first}, rho, e[x], sigma, by_point, ray, t);
    }
  }
}

/// @param near  inverse depth beyond which one pixel in four is enough
ImageRows linearise(const PinholeCamera& camera, const Region& ref, const Plane32& here,
                    const std::vector<float>& inverse_depth, double near, const cv::Mat& other,
                    const std::vector<std::uint8_t>* ignored, const SE3& pose, double blur,
                    const IntensityNoise& noise, bool only_judge) {
  const int width = camera.width, rows = ref.rows;
  const Spans& spans = ref.compared;
  const WarpedRegion map = warped(camera, ref, inverse_depth, ignored, pose);
  const Plane32 there = blurred(width, spans, warped_image(ref, map, other).row(0), blur);
  Plane32 weight(width, rows);
  window_sums(width, spans, map.valid.row(0), kWindowWide, kWindowHigh, weight.row(0), nullptr);
  const Residuals residual =
      residuals(normalised(here, map.valid, weight, spans, noise.least_contrast),
                normalised(there, map.valid, weight, spans, noise.least_contrast), spans);
  ImageRows out;
  const auto measured = residual_noise(residual.value, map.valid, spans);
  if (!measured) return out;
  out.noise = *measured;
  const PatchSums patch =
      patch_sums(residual, map.valid, spans, out.noise * out.noise, noise.mended_px);
  out.contradicted = cv::Mat::zeros(rows, width, CV_8UC1);
  constexpr int kReserved = 1 << 18;  // pixels; large images grow beyond
  if (!only_judge) {
    out.reserve(static_cast<std::size_t>(std::min(kReserved, cv::countNonZero(ref.ground))));
  }
  observe_pixels(camera, ref, map, residual, patch, inverse_depth, near, pose, noise, only_judge,
                 &out);
  return out;
}

/// The observations of all images, each with its own pose as shared parameters.
GroundObservations joined(const std::vector<ImageRows>& images, int num_threads) {
  std::vector<std::size_t> first(images.size() + 1, 0);
  for (std::size_t k = 0; k < images.size(); ++k) first[k + 1] = first[k] + images[k].pixels.size();
  GroundObservations out;
  out.pixels.resize(first.back());
  out.inverse_depth.resize(first.back());
  out.sigma.resize(first.back());
  out.shared_jacobian.resize(static_cast<Eigen::Index>(first.back()),
                             static_cast<Eigen::Index>(6 * images.size()));
  parallel_for(images.size(), num_threads, [&](std::size_t k) {
    const ImageRows& image = images[k];
    const auto at = static_cast<std::ptrdiff_t>(first[k]);
    std::copy(image.pixels.begin(), image.pixels.end(), out.pixels.begin() + at);
    std::copy(image.inverse_depth.begin(), image.inverse_depth.end(),
              out.inverse_depth.begin() + at);
    std::copy(image.sigma.begin(), image.sigma.end(), out.sigma.begin() + at);
    out.shared_jacobian.middleRows(at, static_cast<Eigen::Index>(image.pixels.size())).setZero();
    for (std::size_t i = 0; i < image.by_pose.size(); ++i) {
      out.shared_jacobian.row(at + static_cast<Eigen::Index>(i))
          .segment<6>(static_cast<Eigen::Index>(6 * k)) = image.by_pose[i].transpose();
    }
  });
  return out;
}

}  // namespace

void DirectOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (!good) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) +
                                  ", expected " + expected);
    }
  };
  require(steps >= 1, "steps", steps, ">= 1");
  require(held_out >= 0 && held_out <= 0.5, "held_out", held_out, "from 0 to 0.5");
  require(noise.correlation >= 1, "noise.correlation", noise.correlation, ">= 1");
  require(noise.inflation >= 1, "noise.inflation", noise.inflation, ">= 1");
  require(noise.misregistration_px >= 0, "noise.misregistration_px", noise.misregistration_px,
          ">= 0");
}

struct DirectGround::Impl {
  PinholeCamera camera;
  DirectOptions options;
  std::vector<DirectImage> images;
  std::vector<std::size_t> others;
  std::vector<cv::Mat> intensity;  // of the others, float
  Region region;
  Plane32 finely_blurred{0, 0}, coarsely_blurred{0, 0};  // the reference image in the region

  std::vector<ImageRows> linearise_all(const std::vector<SE3>& frame_from_reference,
                                       const GroundField& field, double blur,
                                       bool only_judge) const {
    const auto width = static_cast<std::size_t>(camera.width);
    std::vector<float> depth(static_cast<std::size_t>(region.rows) * width);
    parallel_for(static_cast<std::size_t>(region.rows), options.num_threads, [&](std::size_t y) {
      float* const row = &depth[y * width];
      field.interpolated_row(static_cast<double>(y) + region.first, field.nodes(), camera.width,
                             row);
      for (std::size_t x = 0; x < width; ++x) row[x] = std::max(row[x], 1e-6F);
    });
    // Near the camera there are more pixels than the ground's smoothness needs.
    const double near = 0.35 * *std::max_element(depth.begin(), depth.end());
    const Plane32& here = blur == kFinalBlur ? finely_blurred : coarsely_blurred;
    std::vector<ImageRows> rows(others.size());
    parallel_for(others.size(), options.num_threads, [&](std::size_t k) {
      rows[k] =
          linearise(camera, region, here, depth, near, intensity[k], images[others[k]].ignored,
                    frame_from_reference[others[k]], blur, options.noise, only_judge);
    });
    return rows;
  }
};

DirectGround::DirectGround(const PinholeCamera& camera, const std::vector<DirectImage>& images,
                           std::size_t reference, const std::vector<std::uint8_t>& ground, int top,
                           const DirectOptions& options)
    : impl_(std::make_unique<Impl>()) {
  options.validate();
  camera.validate();
  const auto width = static_cast<std::size_t>(camera.width);
  const std::size_t total = width * static_cast<std::size_t>(camera.height);
  if (reference >= images.size() || ground.size() != total) {
    throw std::invalid_argument("direct ground: " + std::to_string(ground.size()) +
                                " pixels of ground, expected " + std::to_string(total));
  }
  for (const DirectImage& image : images) {
    if (!image.image || image.image->pixels.size() != total ||
        (image.ignored && image.ignored->size() != total)) {
      throw std::invalid_argument("direct ground: an image or its mask does not fit the camera");
    }
  }
  Impl& m = *impl_;
  m.camera = camera;
  m.options = options;
  m.images = images;
  Region& region = m.region;
  region.first = std::clamp(top, 0, camera.height - 1);
  region.rows = camera.height - region.first;
  const auto intensities_of = [](const GrayImage& image) {
    const cv::Mat bytes(image.height, image.width, CV_8UC1,
                        const_cast<std::uint8_t*>(image.pixels.data()));
    cv::Mat intensity;
    bytes.convertTo(intensity, CV_32F, 1.0, -kMiddle);
    return intensity;
  };
  region.intensity =
      intensities_of(*images[reference].image).rowRange(region.first, camera.height).clone();
  region.ground.create(region.rows, camera.width, CV_32F);
  region.held_out.create(region.rows, camera.width, CV_8U);
  for (int y = 0; y < region.rows; ++y) {
    auto* row = region.held_out.ptr<std::uint8_t>(y);
    for (int x = 0; x < camera.width; ++x) {
      row[x] = is_held_out(x, y + region.first, options.held_out);
    }
  }
  const std::vector<std::uint8_t>* ignored = images[reference].ignored;
  for (int y = 0; y < region.rows; ++y) {
    float* row = region.ground.ptr<float>(y);
    for (int x = 0; x < camera.width; ++x) {
      const std::size_t p =
          static_cast<std::size_t>(y + region.first) * width + static_cast<std::size_t>(x);
      row[x] = ground[p] && !(ignored && (*ignored)[p]) ? 1.0f : 0.0f;
    }
  }
  region.find_spans();
  parallel_for(2, options.num_threads, [&](std::size_t coarse) {
    (coarse ? m.coarsely_blurred : m.finely_blurred) =
        blurred(camera.width, region.compared, region.intensity.ptr<float>(),
                coarse ? kCoarseBlur : kFinalBlur);
  });
  for (std::size_t k = 0; k < images.size(); ++k) {
    if (k == reference) continue;
    m.others.push_back(k);
    m.intensity.push_back(intensities_of(*images[k].image));
  }
}

DirectGround::~DirectGround() = default;

HeldOutPixels DirectGround::judge(const std::vector<SE3>& frame_from_reference,
                                  const GroundField& field) const {
  if (frame_from_reference.size() != impl_->images.size()) {
    throw std::invalid_argument("direct ground: one pose an image is expected");
  }
  HeldOutPixels out;
  for (ImageRows& rows : impl_->linearise_all(frame_from_reference, field, kFinalBlur, true)) {
    out.images.push_back(std::move(rows.judged));
    out.noise.push_back(rows.noise);
  }
  return out;
}

DirectResult DirectGround::refine(const MotionEstimate& motion, GroundField& field) const {
  const Impl& m = *impl_;
  DirectResult out;
  out.frame_from_reference = motion.frame_from_reference;
  out.covariance = motion.covariance;
  const auto columns = static_cast<Eigen::Index>(6 * m.others.size());
  if (motion.frame_from_reference.size() != m.images.size() ||
      motion.covariance.rows() != columns || motion.covariance.cols() != columns) {
    throw std::invalid_argument("direct ground: the motion does not fit the images");
  }
  // What is known exactly (the longest baseline's length) stays so.
  const Eigen::MatrixXd floor = 1e-12 * Eigen::MatrixXd::Identity(columns, columns);
  const Eigen::MatrixXd information =
      (motion.covariance + floor).ldlt().solve(Eigen::MatrixXd::Identity(columns, columns));
  Eigen::VectorXd moved = Eigen::VectorXd::Zero(columns);
  GroundObservations& observations = out.observations;
  std::vector<ImageRows> rows;
  for (int step = 0; step < m.options.steps; ++step) {
    const bool coarse = step == 0 && m.options.steps > 1;
    rows =
        m.linearise_all(out.frame_from_reference, field, coarse ? kCoarseBlur : kFinalBlur, false);
    std::size_t count = 0;
    for (const ImageRows& r : rows) count += r.pixels.size();
    if (count < 1000) {
      out.status = Status::kFailed;
      out.reason = "only " + std::to_string(count) + " pixels of the ground can be compared";
      return out;
    }
    observations = joined(rows, m.options.num_threads);
    const Eigen::VectorXd change = field.update_with_shared(
        observations, 2, m.options.noise.correlation, information, moved, &out.covariance);
    moved += change;
    for (std::size_t k = 0; k < m.others.size(); ++k) {
      SE3& pose = out.frame_from_reference[m.others[k]];
      const auto block = static_cast<Eigen::Index>(6 * k);
      pose = SE3(rotation_from_vector(change.segment<3>(block)) * pose.rotation(),
                 pose.translation() + change.segment<3>(block + 3));
    }
    // The observations, to first order, at the motion as it is now.
    const Eigen::VectorXf shift = observations.shared_jacobian * change.cast<float>();
    for (std::size_t i = 0; i < count; ++i) {
      observations.inverse_depth[i] += static_cast<double>(shift[static_cast<Eigen::Index>(i)]);
    }
  }
  // What the pixels add to the motion is worth less than independent pixels would be.
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(columns, columns);
  const Eigen::MatrixXd added = out.covariance.ldlt().solve(identity) - information;
  out.covariance = (information + added / m.options.noise.inflation).ldlt().solve(identity);
  out.motion_change =
      std::sqrt(std::max(0.0, moved.dot(information * moved)) / static_cast<double>(columns));
  const auto width = static_cast<std::size_t>(m.camera.width);
  out.contradicted.assign(width * static_cast<std::size_t>(m.camera.height), 0);
  for (const ImageRows& r : rows) {
    for (int y = 0; y < r.contradicted.rows; ++y) {
      const auto* from = r.contradicted.ptr<std::uint8_t>(y);
      std::uint8_t* to =
          out.contradicted.data() + static_cast<std::size_t>(y + m.region.first) * width;
      for (std::size_t x = 0; x < width; ++x) to[x] |= from[x];
    }
  }
  out.status = Status::kOk;
  return out;
}

namespace {
constexpr double kCellWide = 16.0, kCellHigh = 4.0;  // px
}

DirectEvidence::DirectEvidence(int width, int height, const HeldOutPixels& before,
                               const HeldOutPixels& after)
    : columns_(static_cast<int>(width / kCellWide) + 1),
      rows_(static_cast<int>(height / kCellHigh) + 1),
      cells_(static_cast<std::size_t>(columns_ * rows_)) {
  const auto earlier = [](const HeldOutPixels::Pixel& a, const HeldOutPixels::Pixel& b) {
    return a.v < b.v || (a.v == b.v && a.u < b.u);
  };
  for (std::size_t k = 0; k < std::min(before.images.size(), after.images.size()); ++k) {
    // Costs are in units of their own noise.
    const double unit = before.noise[k] > 0 ? std::pow(after.noise[k] / before.noise[k], 2) : 1.0;
    std::size_t j = 0;
    for (const HeldOutPixels::Pixel& a : after.images[k]) {
      while (j < before.images[k].size() && earlier(before.images[k][j], a)) ++j;
      if (j == before.images[k].size()) break;
      if (earlier(a, before.images[k][j])) continue;
      const int c = std::clamp(static_cast<int>(a.u / kCellWide), 0, columns_ - 1);
      const int r = std::clamp(static_cast<int>(a.v / kCellHigh), 0, rows_ - 1);
      Costs& cell = cells_[static_cast<std::size_t>(r * columns_ + c)];
      cell.pixels += 1.0;
      cell.before += before.images[k][j].cost;
      cell.after += unit * a.cost;
    }
  }
}

DirectEvidence::Costs DirectEvidence::within(const Eigen::Vector2d& least,
                                             const Eigen::Vector2d& greatest) const {
  Costs out;
  if (cells_.empty()) return out;
  const auto cell = [](double at, double size, int count) {
    return static_cast<int>(std::clamp(std::floor(at / size), 0.0, count - 1.0));
  };
  const int c2 = cell(greatest.x(), kCellWide, columns_);
  const int r2 = cell(greatest.y(), kCellHigh, rows_);
  for (int r = cell(least.y(), kCellHigh, rows_); r <= r2; ++r) {
    for (int c = cell(least.x(), kCellWide, columns_); c <= c2; ++c) {
      const Costs& sum = cells_[static_cast<std::size_t>(r * columns_ + c)];
      out.pixels += sum.pixels;
      out.before += sum.before;
      out.after += sum.after;
    }
  }
  if (out.pixels > 0) {
    out.before /= out.pixels;
    out.after /= out.pixels;
  }
  return out;
}

}  // namespace camber
