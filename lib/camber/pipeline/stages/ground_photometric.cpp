#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "camber/core/threads.h"
#include "camber/pipeline/stages/detail/ground_steps.h"
#include "camber/pipeline/stages/ground.h"

namespace camber::stages {
namespace {

using detail::ProfilePoints;

/// Standard deviations of the motion by the matches, beyond which the intensities contradict it.
constexpr double kMostMotionChange = 4.0;

/// What the intensities measure of the near road, in cells of a few pixels. The nearest road
/// decides how the profile is carried back to the camera, and a flow bends at the lower border of
/// the image.
ProfilePoints photometric_profile(const PinholeCamera& camera, const Correspondences& matches,
                                  const GroundPoints& seen, const GroundObservations& observed) {
  constexpr int kCellWide = 8, kCellHigh = 4;  // px
  constexpr double kMostRelativeSigma = 0.1;   // of a cell's distance
  struct Cell {
    double weight = 0.0, inverse_depth = 0.0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    Eigen::RowVectorXd jacobian;
  };
  const Eigen::Index shared = observed.shared_jacobian.cols();
  const int columns = camera.width / kCellWide + 1;
  std::vector<Cell> cells(static_cast<std::size_t>(columns) *
                          static_cast<std::size_t>(camera.height / kCellHigh + 1));
  for (std::size_t i = 0; i < observed.size(); ++i) {
    const int x = static_cast<int>(observed.pixels[i].x());
    const int y = static_cast<int>(observed.pixels[i].y());
    const int point = y / matches.step * matches.columns + x / matches.step;
    if (!seen.is_roadway[static_cast<std::size_t>(point)]) continue;
    Cell& cell = cells[static_cast<std::size_t>(y / kCellHigh * columns + x / kCellWide)];
    if (cell.weight == 0.0) cell.jacobian.setZero(shared);
    const double weight = 1.0 / (observed.sigma[i] * observed.sigma[i]);
    cell.weight += weight;
    cell.inverse_depth += weight * observed.inverse_depth[i];
    cell.pixel += weight * observed.pixels[i];
    cell.jacobian +=
        weight * observed.shared_jacobian.row(static_cast<Eigen::Index>(i)).cast<double>();
  }
  ProfilePoints out;
  out.correlation = IntensityNoise().correlation;
  std::vector<Eigen::RowVectorXf> rows;
  for (const Cell& cell : cells) {
    if (!(cell.inverse_depth > 0.0)) continue;
    const double rho = cell.inverse_depth / cell.weight;
    const double relative_sigma = 1.0 / (std::sqrt(cell.weight) * rho);
    if (!(std::sqrt(out.correlation) * relative_sigma < kMostRelativeSigma)) continue;
    out.road.points.push_back(camera.ray(Eigen::Vector2d(cell.pixel / cell.weight)) / rho);
    out.road.relative_sigma.push_back(relative_sigma);
    rows.emplace_back((-cell.jacobian / cell.inverse_depth).cast<float>());
  }
  out.road.shared_jacobian.resize(static_cast<Eigen::Index>(rows.size()), shared);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    out.road.shared_jacobian.row(static_cast<Eigen::Index>(k)) = rows[k];
  }
  return out;
}

/// Leaves matches beside vehicles and contradicted pixels nearly without weight: a flow carries
/// what moves there a patch or two out.
void down_weight_beside(const LoadedFrames& frames, const std::vector<std::uint8_t>& contradicted,
                        GroundObservations& observations) {
  constexpr int kReachU = 24, kReachV = 12;  // px
  std::vector<std::uint8_t> near = contradicted;
  const std::vector<std::uint8_t>& vehicle = frames.reference_masks().vehicle;
  for (std::size_t i = 0; i < near.size(); ++i) near[i] |= vehicle[i];
  const cv::Mat in(frames.camera.height, frames.camera.width, CV_8UC1, near.data());
  cv::Mat grown;
  cv::dilate(in, grown,
             cv::getStructuringElement(cv::MORPH_RECT, {2 * kReachU + 1, 2 * kReachV + 1}));
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Eigen::Vector2d& p = observations.pixels[i];
    if (grown.at<std::uint8_t>(static_cast<int>(p.y()), static_cast<int>(p.x()))) {
      observations.sigma[i] *= 100.0;
    }
  }
}

/// Matches with the photometric observations behind them, whose sigmas are put into the matches'
/// correlation.
GroundObservations joined(GroundObservations matched, const GroundObservations& photometric,
                          double sigma_ratio) {
  GroundObservations out = std::move(matched);
  const auto rows = static_cast<Eigen::Index>(out.size());
  const auto more = static_cast<Eigen::Index>(photometric.size());
  out.shared_jacobian.conservativeResize(rows + more, Eigen::NoChange);
  out.shared_jacobian.bottomRows(more) = photometric.shared_jacobian;
  out.pixels.insert(out.pixels.end(), photometric.pixels.begin(), photometric.pixels.end());
  out.inverse_depth.insert(out.inverse_depth.end(), photometric.inverse_depth.begin(),
                           photometric.inverse_depth.end());
  for (const double sigma : photometric.sigma) out.sigma.push_back(sigma_ratio * sigma);
  return out;
}

/// Blocks in which held-out pixels agree less than before by more than chance: the mean of n costs
/// changes by about their mean over sqrt(n), three times that is no chance among some 200 blocks.
RejectedBlocks rejected_blocks(const PinholeCamera& camera, const DirectEvidence& evidence) {
  constexpr double kFewest = 20.0;  // pixels
  RejectedBlocks out;
  out.columns = camera.width / RejectedBlocks::kWide + 1;
  const int rows = camera.height / RejectedBlocks::kHigh + 1;
  bool any = false;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < out.columns; ++c) {
      const Eigen::Vector2d least(c * RejectedBlocks::kWide, r * RejectedBlocks::kHigh);
      const Eigen::Vector2d greatest =
          least + Eigen::Vector2d(RejectedBlocks::kWide - 1, RejectedBlocks::kHigh - 1);
      const DirectEvidence::Costs costs = evidence.within(least, greatest);
      const bool worse = costs.pixels >= kFewest &&
                         costs.after > costs.before * (1.0 + 3.0 / std::sqrt(costs.pixels));
      out.rejected.push_back(worse);
      any = any || worse;
    }
  }
  if (!any) out.rejected.clear();
  return out;
}

/// Leaves the intensities of rejected blocks nearly without weight and gives the matches there
/// theirs back.
/// @param count  of the matches, which stand before the intensities.
void leave_out(const RejectedBlocks& blocks, std::size_t count, const GroundObservations& matched,
               GroundObservations* both) {
  for (std::size_t i = 0; i < both->size(); ++i) {
    if (!blocks.at(both->pixels[i].x(), both->pixels[i].y())) continue;
    if (i < count) {
      both->sigma[i] = matched.sigma[i];
    } else {
      both->sigma[i] *= 100.0;
    }
  }
}

/// Sum of the distances from the reference to all images, baselines.
double travelled(const MotionEstimate& motion, std::size_t reference) {
  double out = 0.0;
  for (std::size_t k = 0; k < motion.frame_from_reference.size(); ++k) {
    if (k != reference) out += motion.frame_from_reference[k].translation().norm();
  }
  return out;
}

}  // namespace

PhotometricGround refine_photometrically(const LoadedFrames& frames, const Correspondences& matches,
                                         const MotionEstimate& motion, const Ground& before,
                                         const GroundOptions& options) {
  PhotometricGround out{before, motion, nullptr, {}, {}, {}};
  if (before.ego.compared > 0) {
    out.agreeing_before = static_cast<double>(before.ego.points) / before.ego.compared;
  }
  std::vector<DirectImage> images(frames.size());
  for (std::size_t k = 0; k < images.size(); ++k) {
    images[k].image = &frames.gray[k];
    images[k].ignored = &frames.masks[k].vehicle;
  }
  DirectOptions direct_options;
  direct_options.num_threads = options.num_threads;
  const DirectGround direct(frames.camera, images, frames.reference,
                            ground_pixels(frames, matches, before),
                            static_cast<int>(before.field->top()) - 2, direct_options);
  const HeldOutPixels judged = direct.judge(motion.frame_from_reference, *before.field);
  auto refined = std::make_shared<GroundField>(*before.field);
  const DirectResult result = direct.refine(motion, *refined);
  if (result.status == Status::kFailed) {
    out.rejection = result.reason;
    return out;
  }
  MotionEstimate moved = motion;
  moved.frame_from_reference = result.frame_from_reference;
  moved.covariance = result.covariance;
  Ground now = before;
  now.seen = triangulate(frames, matches, moved, &before.seen, options);
  const auto ego_by_intensities = [&] {
    return detail::fit_ego(
        frames, moved, photometric_profile(frames.camera, matches, now.seen, result.observations),
        options);
  };
  if (result.motion_change > kMostMotionChange) {
    out.rejection =
        fmt::format("the motion would change by {:.2f} standard deviations", result.motion_change);
    const EgoPlane other = ego_by_intensities();
    if (other.status != Status::kFailed && before.ego.points > 0) {
      const auto length = [&](const MotionEstimate& of, const EgoPlane& ego) {
        return ego.metres_per_baseline * travelled(of, frames.reference);
      };
      out.rejected_log_scale = std::log(length(moved, other) / length(motion, before.ego));
    }
    return out;
  }
  // Matches and intensities together, at the refined motion, and the matches alone.
  const GroundObservations matched = detail::ground_observations(matches, now.seen.points);
  detail::require_found(matched);
  GroundObservations down_weighted = matched;
  down_weight_beside(frames, result.contradicted, down_weighted);
  GroundObservations both =
      joined(std::move(down_weighted), result.observations,
             std::sqrt(direct_options.noise.correlation / GroundFieldOptions().correlation));
  auto by_matches = std::make_shared<GroundField>(*before.field);
  EgoPlane ego;
  parallel_for(3, options.num_threads, [&](std::size_t task) {
    if (task == 0) {
      refined->update(both, 2);
    } else if (task == 1) {
      ego = ego_by_intensities();
    } else {
      by_matches->update(matched, 2);
    }
  });
  if (!detail::set_ego(moved, std::move(ego), &now)) {
    detail::set_ego(
        moved, detail::fit_ego(frames, moved, detail::matched_profile(now.seen), options), &now);
  }
  const auto judge = [&] {
    return DirectEvidence(frames.camera.width, frames.camera.height, judged,
                          direct.judge(moved.frame_from_reference, *refined));
  };
  out.evidence = judge();
  const DirectEvidence::Costs whole = out.evidence.within(
      Eigen::Vector2d::Zero(), Eigen::Vector2d(frames.camera.width, frames.camera.height));
  if (!(whole.pixels >= 200) || !(whole.after < whole.before)) {
    out.rejection = whole.pixels < 200 ? "too few pixels to judge by"
                                       : "pixels left out agree less than before";
    return out;
  }
  out.rejected_blocks = rejected_blocks(frames.camera, out.evidence);
  if (!out.rejected_blocks.rejected.empty()) {
    leave_out(out.rejected_blocks, matched.size(), matched, &both);
    refined->update(both, 2);
    out.evidence = judge();
  }
  now.field = std::move(by_matches);
  out.ground = std::move(now);
  out.motion = std::move(moved);
  out.field = std::move(refined);
  return out;
}

}  // namespace camber::stages
