#include "camber/photometric/road_sweep.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/image/detail/single_threaded_opencv.h"
#include "camber/photometric/plane_search.h"

namespace camber {
namespace {

constexpr double kAhead = 0.04, kAside = 0.06;  // camera heights, of a cell
constexpr double kAlong = 1.5;      // camera heights: longer things point along the road
constexpr double kStep = 0.02;      // of the logarithm
constexpr double kElsewhere = 0.2;  // of the logarithm

/// The road under and before an image, from above: rows ahead, columns to the right.
struct TopView {
  cv::Mat values;   // without what points along the road
  cv::Mat visible;  // 1 where the image shows the place
};

/// Axes of the road in the reference's frame.
struct Axes {
  Eigen::Vector3d right, ahead, up;
};

cv::Mat intensities(const GrayImage& image) {
  const cv::Mat gray(image.height, image.width, CV_8UC1,
                     const_cast<std::uint8_t*>(image.pixels.data()));
  cv::Mat out;
  gray.convertTo(out, CV_32F);
  return out;
}

/// @param image  intensities, without what stands still in the picture.
TopView top_view(const PinholeCamera& camera, const cv::Mat& image, const SE3& from_reference,
                 const Axes& axes, const RoadSweepOptions& options) {
  const int rows = static_cast<int>(options.reach / kAhead);
  const int columns = static_cast<int>(2.0 * options.half_width / kAside);
  cv::Mat u(rows, columns, CV_32FC1), v(rows, columns, CV_32FC1);
  cv::Mat visible = cv::Mat::zeros(rows, columns, CV_32FC1);
  const Eigen::Matrix3d rotation = from_reference.rotation_matrix();
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const Eigen::Vector3d place = (r + 0.5) * kAhead * axes.ahead +
                                    ((c + 0.5) * kAside - options.half_width) * axes.right -
                                    axes.up;
      const auto pixel = camera.project(rotation * place);
      const bool inside = pixel && camera.contains(*pixel, 1.0);
      u.at<float>(r, c) = inside ? static_cast<float>(pixel->x()) : -1.0F;
      v.at<float>(r, c) = inside ? static_cast<float>(pixel->y()) : -1.0F;
      visible.at<float>(r, c) = inside ? 1.0F : 0.0F;
    }
  }
  cv::Mat seen;
  cv::remap(image, seen, u, v, cv::INTER_LINEAR);
  // The mean along the road of what is visible.
  const cv::Size along(1, static_cast<int>(kAlong / kAhead) | 1);
  cv::Mat mean, weight;
  cv::blur(seen.mul(visible), mean, along);
  cv::blur(visible, weight, along);
  cv::divide(mean, cv::max(weight, 1e-3), mean);
  return {(seen - mean).mul(visible), visible};
}

/// What two top views have in common at a shift, in cells.
struct Sums {
  double ab = 0.0, aa = 0.0, bb = 0.0;
};

/// @param ahead, aside  that b's place is farther than a's, cells.
void add_products(const TopView& a, const TopView& b, double ahead, double aside, Sums* sums) {
  const int rows = a.values.rows, columns = a.values.cols;
  const int dr = static_cast<int>(std::floor(ahead)), dc = static_cast<int>(std::lround(aside));
  const auto share = static_cast<float>(ahead - dr);
  const int first = std::max(0, -dr), last = std::min(rows, rows - dr - 1);
  const int left = std::max(0, -dc), right = std::min(columns, columns - dc);
  float ab = 0, aa = 0, bb = 0;
  for (int r = first; r < last; ++r) {
    // What is at row r of b, is at row r + ahead of a.
    const auto* a0 = a.values.ptr<float>(r + dr) + dc;
    const auto* a1 = a.values.ptr<float>(r + dr + 1) + dc;
    const auto* ma = a.visible.ptr<float>(r + dr) + dc;
    const auto* in_b = b.values.ptr<float>(r);
    const auto* mb = b.visible.ptr<float>(r);
    for (int c = left; c < right; ++c) {
      const float x = ((1.0F - share) * a0[c] + share * a1[c]) * mb[c], y = in_b[c] * ma[c];
      ab += x * y;
      aa += x * x;
      bb += y * y;
    }
  }
  sums->ab += ab;
  sums->aa += aa;
  sums->bb += bb;
}

struct Correlation {
  double value = -1.0;
  int pairs = 0;
};

/// Of all pairs of views as one.
/// @param at      ahead and right of each view's foot, baselines.
/// @param shrink  the views' cells are so many times as large.
Correlation correlation_of(const std::vector<TopView>& views,
                           const std::vector<Eigen::Vector2d>& at, double baseline, double shrink,
                           double greatest_travel) {
  Correlation out;
  Sums sums;
  for (std::size_t a = 0; a < views.size(); ++a) {
    for (std::size_t b = a + 1; b < views.size(); ++b) {
      const Eigen::Vector2d moved = baseline * (at[b] - at[a]);
      if (std::abs(moved[0]) > greatest_travel) continue;
      add_products(views[a], views[b], moved[0] / (shrink * kAhead), moved[1] / (shrink * kAside),
                   &sums);
      ++out.pairs;
    }
  }
  const double power = std::sqrt(sums.aa * sums.bb);
  if (power > 0.0) out.value = sums.ab / power;
  return out;
}

TopView half(const TopView& view) {
  TopView out;
  const cv::Size size(view.values.cols / 2, view.values.rows / 2);
  const cv::Rect whole(0, 0, 2 * size.width, 2 * size.height);
  cv::resize(view.values(whole), out.values, size, 0, 0, cv::INTER_AREA);
  cv::resize(view.visible(whole), out.visible, size, 0, 0, cv::INTER_AREA);
  return out;
}

}  // namespace

RoadSweepResult sweep_road(const PinholeCamera& camera, const std::vector<const GrayImage*>& images,
                           const MotionEstimate& motion, std::size_t reference,
                           const RoadSweepOptions& options) {
  if (images.size() < 2 || images.size() != motion.frame_from_reference.size() ||
      reference >= images.size()) {
    throw std::invalid_argument("road sweep: images and poses differ in number");
  }
  for (const GrayImage* image : images) {
    if (!image || image->width != camera.width || image->height != camera.height) {
      throw std::invalid_argument("road sweep: images and camera differ in size");
    }
  }
  RoadSweepResult out;
  const SingleThreadedOpenCv guard;
  const Eigen::Vector3d travel = travel_direction(motion, reference);
  const Eigen::Vector3d up = road_normal(travel, 0.0);
  const Axes axes{travel.cross(up), travel, up};
  const double horizon = camera.cy + camera.fy * travel.y() / std::max(0.1, travel.z());
  if (!(horizon < camera.height - 2)) return out;
  cv::Mat mean = cv::Mat::zeros(camera.height, camera.width, CV_32FC1);
  for (const GrayImage* image : images) mean += intensities(*image);
  mean /= static_cast<double>(images.size());
  std::vector<TopView> views(images.size());
  std::vector<Eigen::Vector2d> at(images.size());  // ahead, right: of the foot, in baselines
  parallel_for(images.size(), options.num_threads, [&](std::size_t k) {
    const SE3& pose = motion.frame_from_reference[k];
    views[k] = top_view(camera, intensities(*images[k]) - mean, pose, axes, options);
    const Eigen::Vector3d center = pose.inverse().translation();
    at[k] = {axes.ahead.dot(center), axes.right.dot(center)};
  });
  Sums texture;
  for (const TopView& view : views) add_products(view, view, 0.0, 0.0, &texture);
  double cells = 0.0;
  for (const TopView& view : views) cells += cv::sum(view.visible)[0];
  out.texture = std::sqrt(texture.aa / std::max(1.0, cells));
  const auto correlations = [&](const std::vector<TopView>& of, double shrink,
                                const std::vector<double>& logs) {
    std::vector<Correlation> found(logs.size());
    parallel_for(logs.size(), options.num_threads, [&](std::size_t i) {
      found[i] = correlation_of(of, at, std::exp(logs[i]), shrink, options.greatest_travel);
    });
    return found;
  };
  // Half the resolution over the whole range, then the best one's neighbours.
  std::vector<TopView> coarse(views.size());
  for (std::size_t k = 0; k < views.size(); ++k) coarse[k] = half(views[k]);
  std::vector<double> logs;
  for (double l = options.least_log_baseline; l <= options.greatest_log_baseline;
       l += 2.0 * kStep) {
    logs.push_back(l);
  }
  const std::vector<Correlation> swept = correlations(coarse, 2.0, logs);
  const auto best_of = [](const std::vector<Correlation>& of) {
    return static_cast<std::size_t>(
        std::max_element(
            of.begin(), of.end(),
            [](const Correlation& a, const Correlation& b) { return a.value < b.value; }) -
        of.begin());
  };
  const std::size_t peak = best_of(swept);
  for (std::size_t i = 0; i < logs.size(); ++i) {
    if (std::abs(logs[i] - logs[peak]) > kElsewhere) {
      out.rival = std::max(out.rival, swept[i].value);
    }
  }
  out.lead = swept[peak].value - out.rival;
  std::vector<double> near;
  for (int i = -3; i <= 3; ++i) near.push_back(logs[peak] + i * kStep);
  const std::vector<Correlation> fine = correlations(views, 1.0, near);
  const std::size_t best = best_of(fine);
  out.log_baseline = near[best];
  out.correlation = fine[best].value;
  out.pairs = fine[best].pairs;
  out.informative = static_cast<int>(images.size()) >= options.least_images &&
                    out.correlation > options.least_correlation && out.lead > options.least_lead;
  if (best > 0 && best + 1 < near.size()) {
    const double before = fine[best - 1].value, after = fine[best + 1].value;
    const double bend = before - 2.0 * out.correlation + after;
    if (bend < 0.0) out.log_baseline += kStep * 0.5 * (before - after) / bend;
  }
  return out;
}

}  // namespace camber
