#include "camber/drive/detail/moving_path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "camber/core/random.h"

namespace camber::internal {
namespace {

/// Views at 10 Hz of a vehicle that comes along the other lane at 6 m/s, from a camera that drives
/// at 8 m/s; each is a few per cent off in its distance.
struct MadeViews {
  std::vector<MovingView> views;
  std::vector<Eigen::Vector3d> truth;

  /// @param acceleration  m/s^2, of the vehicle
  MadeViews(double sigma, double acceleration) {
    const CounterRandom random(3);
    for (int k = 0; k < 40; ++k) {
      const double t = 0.1 * k;
      truth.emplace_back(-2.5, 1.4, 70.0 - 6.0 * t - 0.5 * acceleration * t * t);
      MovingView view;
      view.time_s = t;
      view.world_from_camera = SE3(Eigen::Quaterniond::Identity(), {0.0, 0.0, 8.0 * t});
      const Eigen::Vector3d here = view.world_from_camera.inverse() * truth.back();
      view.place = std::exp(sigma * random.normal(k)) * here;
      view.direction_sigma = 0.15 / here.norm();
      view.range_sigma = sigma;
      views.push_back(view);
    }
  }
  double rms(const std::vector<MovingPlace>& places) const {
    double sum = 0.0;
    for (std::size_t k = 0; k < places.size(); ++k) {
      sum += (places[k].position - truth[k]).squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(places.size()));
  }
  double own_rms() const {
    double sum = 0.0;
    for (std::size_t k = 0; k < views.size(); ++k) {
      sum += (views[k].world_from_camera * views[k].place - truth[k]).squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(views.size()));
  }
};

TEST(MovingPath, OfExactViewsIsNearlyExact) {
  for (const auto& [acceleration, most] : {std::pair(0.0, 1e-5), {0.5, 0.25}}) {
    std::vector<MovingView> views = MadeViews(1e-9, acceleration).views;
    for (MovingView& view : views) view.range_sigma = 0.05;
    const auto path = moving_path(views);
    ASSERT_TRUE(path);
    // A velocity that is a random walk holds it back: by a tenth of what a view is off, 2 to 3 m.
    EXPECT_LT(MadeViews(1e-9, acceleration).rms(*path), most);
  }
}

TEST(MovingPath, IsBetterThanItsViews) {
  const MadeViews made(0.05, 0.5);
  const auto path = moving_path(made.views);
  ASSERT_TRUE(path);
  EXPECT_LT(made.rms(*path), 0.6 * made.own_rms());
  // What is stated covers it: information is counted once in five, the errors are independent.
  double squares = 0.0;
  for (std::size_t k = 0; k < path->size(); ++k) {
    const Eigen::Vector3d off = (*path)[k].position - made.truth[k];
    squares += off.dot((*path)[k].covariance.inverse() * off) / 3.0;
  }
  EXPECT_LT(squares / static_cast<double>(path->size()), 1.0);
  EXPECT_GT(squares / static_cast<double>(path->size()), 0.02);
}

TEST(MovingPath, LeavesOutliersAndBridgesWhatIsNotMeasured) {
  MadeViews made(0.01, 0.5);
  made.views[20].place *= 2.0;
  for (std::size_t k = 28; k < 33; ++k) {
    made.views[k].measured = false;
    made.views[k].place *= 5.0;
  }
  const auto path = moving_path(made.views);
  ASSERT_TRUE(path);
  EXPECT_LT(made.rms(*path), 0.5);
  EXPECT_GT((*path)[30].covariance.trace(), (*path)[38].covariance.trace());
}

TEST(MovingPath, NeedsThreeViewsInOrder) {
  MadeViews made(0.01, 0.5);
  std::vector<MovingView> views(made.views.begin(), made.views.begin() + 4);
  EXPECT_TRUE(moving_path(views));
  std::swap(views[1].time_s, views[2].time_s);
  EXPECT_FALSE(moving_path(views));
  std::swap(views[1].time_s, views[2].time_s);
  views[0].measured = views[1].measured = false;
  EXPECT_FALSE(moving_path(views));
}

}  // namespace
}  // namespace camber::internal
