#include "camber/plane/detail/cloud_passes.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>
#include <vector>

#include "camber/core/threads.h"

namespace camber::detail {

namespace kernels = plane_kernels;

namespace {

constexpr std::size_t kCounted = 131072;  // points that decide between competitors
constexpr double kCountSigmas = 4.0;      // within which they count: few that belong are left out
// Whole blocks: sums are added in the chunks' order, whoever computed them.
constexpr std::size_t kChunk = 32 * kernels::kBlock;

/// Lists of chunks that are put one behind the other, in the chunks' order, while others are still
/// being made.
class JoinedLists {
 public:
  JoinedLists(std::size_t chunks, std::vector<int>* out) : early_(chunks), out_(*out) {}

  /// The list of a chunk, each once, by any thread.
  void add(std::size_t chunk, const int* list, std::size_t count) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (chunk != next_) {
      early_[chunk].emplace(list, list + count);
      return;
    }
    out_.insert(out_.end(), list, list + count);
    for (++next_; next_ < early_.size() && early_[next_]; ++next_) {
      out_.insert(out_.end(), early_[next_]->begin(), early_[next_]->end());
      early_[next_].reset();
    }
  }

 private:
  std::mutex mutex_;
  std::vector<std::optional<std::vector<int>>> early_;
  std::size_t next_ = 0;  // chunk
  std::vector<int>& out_;
};

}  // namespace

double count_support(const PointColumns& source, const std::array<float, 3>& pivot,
                     const PlaneCandidate& c) {
  const std::size_t blocks = (source.size + kernels::kBlock - 1) / kernels::kBlock;
  const std::size_t most = kCounted / kernels::kBlock;
  const std::size_t step = std::max<std::size_t>(1, blocks / most);
  alignas(32) float x[kernels::kBlock], y[kernels::kBlock], z[kernels::kBlock],
      weight[kernels::kBlock];
  kernels::Window window = c.window.as_float();
  // Its edges, sharp.
  window.half_u *= 0.5f / 0.48f;
  window.half_v *= 0.5f / 0.48f;
  window.ramp_u *= 1e-3f;
  window.ramp_v *= 1e-3f;
  const kernels::Target target = {c.plane.as_float(), window,
                                  static_cast<float>(kCountSigmas * kCountSigmas)};
  double count = 0.0;
  for (std::size_t block = 0; block < blocks; block += step) {
    const std::size_t begin = block * kernels::kBlock;
    const std::size_t m = std::min(kernels::kBlock, source.size - begin);
    const std::size_t first = source.stride * begin;
    kernels::load_points({source.x + first, source.y + first, source.z + first, source.stride, m},
                         pivot.data(), 1.0f, {x, y, z, weight});
    for (std::size_t k = m; k < kernels::padded(m); ++k) x[k] = y[k] = z[k] = weight[k] = 0.0f;
    c.noise.weigh(c.plane.n, c.plane.d, m, x, y, z, source.sigma ? source.sigma + begin : nullptr,
                  source.covariance ? source.covariance + begin : nullptr, weight);
    kernels::Moments moments;
    kernels::accumulate({x, y, z, weight, kernels::padded(m)}, target, kernels::Loss::kReweighted,
                        false, &moments);
    count += moments.count;
  }
  return count;
}

void load_many(const PointColumns& source, const std::array<float, 3>& pivot, PointArrays* many) {
  constexpr std::size_t kMost = 65536;
  const std::size_t every = (source.size + kMost - 1) / kMost;
  const std::size_t n = (source.size + every - 1) / every;
  PointArrays& s = *many;
  s.resize(n, source.sigma != nullptr, source.covariance != nullptr);
  kernels::load_points({source.x, source.y, source.z, source.stride * every, n}, pivot.data(), 1.0f,
                       {s.x.data(), s.y.data(), s.z.data(), s.w.data()});
  for (std::size_t k = 0; k < n; ++k) {
    // Far from everything, so that no plane holds those that are not usable.
    if (!(s.w[k] > 0.0f)) s.x[k] = s.y[k] = s.z[k] = 1e15f;
    if (source.sigma) s.sigma[k] = source.sigma[every * k];
    if (source.covariance) s.covariance[k] = source.covariance[every * k];
  }
}

CloudMoments sum_cloud_moments(const PointColumns& source, const std::array<float, 3>& pivot,
                               const PlaneCandidate& c, bool finish, bool list,
                               double expected_share, int num_threads) {
  const std::size_t n = source.size;
  const std::size_t chunks = (n + kChunk - 1) / kChunk;
  std::vector<kernels::Moments> parts(chunks);
  const kernels::Target target = {c.plane.as_float(), c.window.as_float(),
                                  static_cast<float>(kBiweight * kBiweight),
                                  static_cast<float>(kInlierSigmas * kInlierSigmas)};
  list = list && finish;
  CloudMoments out;
  JoinedLists lists(chunks, &out.inliers);
  if (list) {
    out.inliers.reserve(static_cast<std::size_t>(std::min(1.0, 1.1 * expected_share + 0.2) *
                                                 static_cast<double>(n)));
  }
  const bool same = c.noise.kind == NoiseKind::kSame;
  const float same_weight = same ? static_cast<float>(1.0 / (c.noise.scale * c.noise.scale)) : 1.0f;
  const auto work = [&](std::size_t chunk) {
    alignas(32) float x[kernels::kBlock], y[kernels::kBlock], z[kernels::kBlock],
        weight[kernels::kBlock];
    alignas(32) std::int32_t mask[kernels::kBlock];
    int inliers[kChunk + kernels::kLanes];
    std::size_t filled = 0;
    kernels::Moments& moments = parts[chunk];
    const std::size_t chunk_end = std::min(n, (chunk + 1) * kChunk);
    for (std::size_t begin = chunk * kChunk; begin < chunk_end; begin += kernels::kBlock) {
      const std::size_t m = std::min(kernels::kBlock, chunk_end - begin);
      const std::size_t first = source.stride * begin;
      const kernels::StridedPoints points = {source.x + first, source.y + first, source.z + first,
                                             source.stride, m};
      if (same) {
        filled += kernels::accumulate_and_list(points, pivot.data(), same_weight, target,
                                               static_cast<int>(begin),
                                               list ? inliers + filled : nullptr, &moments);
        continue;
      }
      kernels::load_points(points, pivot.data(), 1.0f, {x, y, z, weight});
      const std::size_t rows = kernels::padded(m);
      for (std::size_t k = m; k < rows; ++k) x[k] = y[k] = z[k] = weight[k] = 0.0f;
      c.noise.weigh(c.plane.n, c.plane.d, m, x, y, z, source.sigma ? source.sigma + begin : nullptr,
                    source.covariance ? source.covariance + begin : nullptr, weight);
      if (!finish) {
        kernels::accumulate({x, y, z, weight, rows}, target, kernels::Loss::kNewton, false,
                            &moments);
        continue;
      }
      kernels::accumulate_and_mark({x, y, z, weight, rows}, target, list ? mask : nullptr,
                                   source.stride == 3 && begin + 2 * kernels::kBlock <= n
                                       ? source.x + first + 3 * kernels::kBlock
                                       : nullptr,
                                   &moments);
      if (!list) continue;
      for (std::size_t k = 0; k < m; ++k) {
        inliers[filled] = static_cast<int>(begin + k);
        filled += mask[k] != 0 ? 1 : 0;
      }
    }
    if (list) lists.add(chunk, inliers, filled);
  };
  parallel_for(chunks, num_threads, work);
  for (const kernels::Moments& part : parts) out.moments += part;
  return out;
}

}  // namespace camber::detail
