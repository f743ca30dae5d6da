#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "camber/plane/noise_model.h"
#include "camber/plane/plane_solver.h"

namespace camber::detail {

/// Draws rows of a set by numbers that the rows bear, not by their place in it: a row more or less
/// changes few draws, where the k-th of the set would be another row from there on.
class KeyedDraws {
 public:
  KeyedDraws();
  void clear();
  void add(std::uint64_t key, std::uint32_t row);
  /// A row for 64 random bits; at least one row must have been added.
  std::uint32_t draw(std::uint64_t bits) const;

 private:
  static constexpr std::size_t kSlots = 256;
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  std::array<std::uint64_t, kSlots> key_;  // the least in each slot
  std::array<std::uint32_t, kSlots> row_;
};

/// Noise by neighbourhoods of points that lie in rows [first, second): in each the best of a few
/// minimal samples (least quantile of squares), then the residuals of a refit; the noise of the
/// cloud is a low quantile over neighbourhoods, so that those with kerbs, cars or creases do not
/// count. Sets model->scale for kSame; for kPower the law, or kIsotropic if it cannot be learnt.
/// @param keys  a number for each row by which rows are drawn (see KeyedDraws); empty: by their
/// place in the neighbourhood
/// @param least  m, the smallest deviation to answer, > 0
/// The same for any number of threads.
void learn_local_noise(const PointArrays& points,
                       const std::vector<std::pair<std::size_t, std::size_t>>& neighbourhoods,
                       const std::vector<std::uint64_t>& keys, const Eigen::Vector3d& up,
                       double max_tilt, double least, std::uint64_t seed, int num_threads,
                       NoiseModel* model);

}  // namespace camber::detail
