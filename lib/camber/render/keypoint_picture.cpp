#include "camber/render/keypoint_picture.h"

#include <array>
#include <string>
#include <vector>

#include "camber/render/canvas.h"
#include "camber/render/picture_file.h"
#include "camber/render/wireframe.h"

namespace camber {
namespace {

constexpr int kWidth = 1200, kHeight = 900;  // px
constexpr double kScale = 230.0;             // px / m

/// Orthographic view: where the vehicle frame's origin is, and its axes, px / m.
struct Panel {
  Eigen::Vector2d origin;
  Eigen::Matrix<double, 2, 3> axes;
  bool right_side = false;  ///< whose points have numbers

  Eigen::Vector2d at(const Eigen::Vector3d& x) const { return origin + axes * x; }
};

void draw(const Panel& panel, const KeypointMatrix& keypoints, Canvas* canvas) {
  const Color ink{40, 44, 52}, far{170, 176, 186}, dot{196, 58, 44}, paper{255, 255, 255};
  const int first = panel.right_side ? kNumSideKeypoints : 0;
  const auto numbered = [&](int i) { return i >= first && i < first + kNumSideKeypoints; };
  std::vector<Segment2> near_lines, far_lines;
  for (const auto& [a, b] : wireframe_edges()) {
    const Segment2 line{panel.at(keypoints.col(a)), panel.at(keypoints.col(b))};
    (numbered(a) && numbered(b) ? near_lines : far_lines).push_back(line);
  }
  canvas->segments(far_lines, 1.5, far);
  canvas->segments(near_lines, 2.5, ink);
  for (int i = 0; i < kNumKeypoints; ++i) {
    if (!numbered(i)) canvas->disc(panel.at(keypoints.col(i)), 3.5, far);
  }
  for (int i = 0; i < kNumKeypoints; ++i) {
    if (numbered(i)) canvas->disc(panel.at(keypoints.col(i)), 6.0, dot);
  }
  // Numbers stand away from the middle of the side.
  const Eigen::Vector2d middle =
      panel.at(keypoints.middleCols(first, kNumSideKeypoints).rowwise().mean());
  for (int i = first; i < first + kNumSideKeypoints; ++i) {
    const Eigen::Vector2d place = panel.at(keypoints.col(i));
    const bool wheel = i - first < 2;
    const Eigen::Vector2d out =
        wheel ? Eigen::Vector2d(0.0, 1.0) : Eigen::Vector2d((place - middle).normalized());
    canvas->text_with_halo(place + 22.0 * out, std::to_string(i), 24.0, ink, paper,
                           TextAnchor::kCenter, true);
  }
}

}  // namespace

Image draw_keypoint_picture(const ShapePrior& prior) {
  Image out = make_picture(kWidth, kHeight, 255);
  Canvas canvas(out);
  const KeypointMatrix keypoints = prior.keypoints(prior.mean_dimensions());
  Panel side;  // from the left: the front on the left
  side.origin = {0.5 * kWidth, 400.0};
  side.axes << -kScale, 0, 0, 0, -kScale, 0;
  draw(side, keypoints, &canvas);
  Panel oblique;  // from the front right, above
  oblique.origin = {0.5 * kWidth, 830.0};
  oblique.right_side = true;
  oblique.axes << 0.8 * kScale, 0, -0.45 * kScale, 0.12 * kScale, -0.95 * kScale, 0.2 * kScale;
  draw(oblique, keypoints, &canvas);
  return out;
}

}  // namespace camber
