#include "camber/road/point_tree.h"

#include <algorithm>
#include <cmath>

#include "camber/core/random.h"

namespace camber {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

constexpr std::size_t kLeafPoints = 48;    // largest leaf; halving leaves 24 to 48
constexpr std::size_t kBlockPoints = 320;  // largest block

}  // namespace

PointTree::PointTree(const RoadCloud& cloud, const Vector3d& up, std::uint64_t seed,
                     std::size_t most_points) {
  const Vector3d z = up.normalized();
  Vector3d e1, e2;
  UncertainPlane::make_axes(z, std::abs(z.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitY(), &e1,
                            &e2);
  frame_.level_from_cloud.row(0) = e1;
  frame_.level_from_cloud.row(1) = e2;
  frame_.level_from_cloud.row(2) = z;

  const auto usable = [&](std::size_t i) {
    const Eigen::Vector3f& p = cloud.points[i];
    return std::abs(p.x()) < 1e15f && std::abs(p.y()) < 1e15f && std::abs(p.z()) < 1e15f;
  };
  std::vector<std::uint32_t> chosen;
  const std::size_t n = cloud.size();
  if (n > most_points) {
    const CounterRandom random(seed, 21);
    const double slice = static_cast<double>(n) / static_cast<double>(most_points);
    for (std::size_t k = 0; k < most_points; ++k) {
      const std::size_t i = std::min(
          n - 1, static_cast<std::size_t>((static_cast<double>(k) + random.uniform(k)) * slice));
      if (usable(i)) chosen.push_back(static_cast<std::uint32_t>(i));
    }
  } else {
    chosen.reserve(n);
    for (std::size_t i = 0; i < n; ++i) {
      if (usable(i)) chosen.push_back(static_cast<std::uint32_t>(i));
    }
  }
  size_ = chosen.size();
  if (size_ == 0) return;

  // The pivot: medians, which no far point can move.
  const std::size_t step = std::max<std::size_t>(1, size_ / 1024);
  std::vector<float> values;
  Eigen::Vector3f pivot;
  for (int axis = 0; axis < 3; ++axis) {
    values.clear();
    for (std::size_t k = 0; k < size_; k += step) values.push_back(cloud.points[chosen[k]][axis]);
    pivot[axis] = static_cast<float>(quantile(values, 0.5));
  }
  frame_.pivot = cloud.origin + pivot.cast<double>();
  const Eigen::Matrix3f turn = frame_.level_from_cloud.cast<float>();
  rows_.resize(size_);
  for (std::size_t k = 0; k < size_; ++k) {
    const Eigen::Vector3f p = turn * (cloud.points[chosen[k]] - pivot);
    rows_[k] = {p.x(), p.y(), p.z(), chosen[k]};
  }
  values.clear();
  for (std::size_t k = 0; k < size_; k += step) {
    values.push_back(std::hypot(rows_[k].x, rows_[k].y, rows_[k].z));
  }
  spread_ = quantile(values, 0.9);

  nodes_.reserve(size_ / 8 + 16);
  build(0, size_, false);

  // Rows in leaf order, each leaf padded.
  std::size_t total = 0;
  for (Leaf& leaf : leaves_) {
    const std::size_t count = leaf.end - leaf.begin;
    total += kernels::padded(count);
  }
  PointArrays& s = points_;
  s.resize(total, !cloud.sigmas.empty(), !cloud.covariances.empty());
  cloud_index_.assign(total, kPadding);
  std::size_t at = 0;
  for (Leaf& leaf : leaves_) {
    const std::size_t from = leaf.begin, count = leaf.end - leaf.begin;
    leaf.begin = at;
    leaf.end = at + count;
    leaf.padded_end = at + kernels::padded(count);
    for (std::size_t k = 0; k < count; ++k) {
      const Row& row = rows_[from + k];
      s.x[at + k] = row.x;
      s.y[at + k] = row.y;
      s.z[at + k] = row.z;
      s.w[at + k] = 1.0f;
      cloud_index_[at + k] = row.index;
      if (!s.sigma.empty()) s.sigma[at + k] = cloud.sigmas[row.index];
      if (!s.covariance.empty()) {
        const std::array<float, 6>& c = cloud.covariances[row.index];
        Matrix3d full;
        full << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
        const Matrix3d level = frame_.level_from_cloud * full * frame_.level_from_cloud.transpose();
        const auto f = [](double value) { return static_cast<float>(value); };
        s.covariance[at + k] = {f(level(0, 0)), f(level(0, 1)), f(level(0, 2)),
                                f(level(1, 1)), f(level(1, 2)), f(level(2, 2))};
      }
    }
    at = leaf.padded_end;
  }
  rows_.clear();
  rows_.shrink_to_fit();
  find_neighbours();
}

int PointTree::build(std::size_t begin, std::size_t end, bool in_block) {
  const int id = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  const bool new_block = !in_block && end - begin <= kBlockPoints;
  if (new_block) blocks_.push_back({leaves_.size(), leaves_.size()});
  if (end - begin <= kLeafPoints) {
    Leaf leaf;
    leaf.begin = begin;
    leaf.end = end;
    // Box without the outermost point on each side, if there are enough.
    const std::size_t count = end - begin, skip = count >= 12 ? 1 : 0;
    std::array<float, kLeafPoints> values;
    for (int axis = 0; axis < 2; ++axis) {
      for (std::size_t k = 0; k < count; ++k) {
        values[k] = axis == 0 ? rows_[begin + k].x : rows_[begin + k].y;
      }
      std::sort(values.begin(), values.begin() + static_cast<long>(count));
      leaf.low[axis] = values[skip];
      leaf.high[axis] = values[count - 1 - skip];
    }
    nodes_[id].leaf = static_cast<int>(leaves_.size());
    nodes_[id].low = leaf.low;
    nodes_[id].high = leaf.high;
    leaves_.push_back(leaf);
  } else {
    // Width and middle from a few points: far strays must not decide.
    constexpr std::size_t kLook = 25;
    std::array<float, kLook> look[2];
    for (std::size_t j = 0; j < kLook; ++j) {
      const Row& row = rows_[begin + (end - begin) * (2 * j + 1) / (2 * kLook)];
      look[0][j] = row.x;
      look[1][j] = row.y;
    }
    std::sort(look[0].begin(), look[0].end());
    std::sort(look[1].begin(), look[1].end());
    const int axis = look[0][kLook - 2] - look[0][1] >= look[1][kLook - 2] - look[1][1] ? 0 : 1;
    float middle = look[axis][kLook / 2];
    std::size_t cut = begin;
    if (axis == 0) {
      for (std::size_t k = begin; k < end; ++k) {
        const Row row = rows_[k];
        rows_[k] = rows_[cut];
        rows_[cut] = row;
        cut += row.x < middle ? 1 : 0;
      }
    } else {
      for (std::size_t k = begin; k < end; ++k) {
        const Row row = rows_[k];
        rows_[k] = rows_[cut];
        rows_[cut] = row;
        cut += row.y < middle ? 1 : 0;
      }
    }
    // Many equal coordinates leave one side nearly empty: halve exactly.
    if (cut - begin < (end - begin) / 8 || end - cut < (end - begin) / 8) {
      cut = begin + (end - begin) / 2;
      const auto less = [axis](const Row& l, const Row& r) {
        return axis == 0 ? l.x < r.x : l.y < r.y;
      };
      std::nth_element(rows_.begin() + static_cast<long>(begin),
                       rows_.begin() + static_cast<long>(cut),
                       rows_.begin() + static_cast<long>(end), less);
      middle = axis == 0 ? rows_[cut].x : rows_[cut].y;
    }
    const int below = build(begin, cut, in_block || new_block);
    const int above = build(cut, end, in_block || new_block);
    Node& node = nodes_[id];
    node.axis = axis;
    node.split = middle;
    node.below = below;
    node.above = above;
    node.low = nodes_[below].low.min(nodes_[above].low);
    node.high = nodes_[below].high.max(nodes_[above].high);
  }
  if (new_block) blocks_.back().last = leaves_.size();
  return id;
}

void PointTree::find_neighbours() {
  neighbours_.assign(leaves_.size(), {});
  std::vector<int> stack;
  for (std::size_t i = 0; i < leaves_.size(); ++i) {
    const Leaf& leaf = leaves_[i];
    // Half a leaf's size bridges the gaps that chance leaves between points.
    const Eigen::Array2f size = (leaf.high - leaf.low).max(0.0f);
    const float reach = 0.5f * std::sqrt(std::max(size[0] * size[1], 0.0f)) + 1e-6f;
    const Eigen::Array2f low = leaf.low - reach, high = leaf.high + reach;
    stack.assign(1, 0);
    while (!stack.empty()) {
      const Node& node = nodes_[static_cast<std::size_t>(stack.back())];
      stack.pop_back();
      if ((node.low > high).any() || (node.high < low).any()) continue;
      if (node.leaf >= 0) {
        if (node.leaf != static_cast<int>(i)) neighbours_[i].push_back(node.leaf);
      } else {
        stack.push_back(node.above);
        stack.push_back(node.below);
      }
    }
  }
  // Neighbourhood is mutual.
  const std::vector<std::vector<int>> found = neighbours_;
  for (std::size_t i = 0; i < found.size(); ++i) {
    for (const int j : found[i])
      neighbours_[static_cast<std::size_t>(j)].push_back(static_cast<int>(i));
  }
  for (std::vector<int>& list : neighbours_) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
}

int PointTree::locate(float x, float y) const {
  if (nodes_.empty()) return -1;
  std::size_t id = 0;
  while (nodes_[id].leaf < 0) {
    const Node& node = nodes_[id];
    const float value = node.axis == 0 ? x : y;
    id = static_cast<std::size_t>(value < node.split ? node.below : node.above);
  }
  return nodes_[id].leaf;
}

}  // namespace camber
