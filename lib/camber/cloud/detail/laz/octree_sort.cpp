#include "camber/cloud/detail/laz/octree_sort.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "camber/cloud/detail/las_format.h"
#include "camber/core/interruption.h"

namespace camber::laz {
namespace {

// Places are whole numbers of 31 bits an axis, of which the uppermost are the cell of a node.
constexpr int kBits = 31, kCellBits = 7;
constexpr std::int32_t kMostLevels = kBits - kCellBits;
static_assert(kOctreeCells == 1 << kCellBits, "cells of a node");

using Place = std::array<std::uint32_t, 3>;

/// Which of a node's cells have a point.
class Occupied {
 public:
  explicit Occupied(std::int32_t level)
      : shift_(kMostLevels - level), taken_(std::size_t{1} << (3 * kCellBits), false) {}

  /// Whether it is the first point of its cell.
  bool take(const Place& place) {
    std::size_t cell = 0;
    for (const std::uint32_t x : place) cell = cell << kCellBits | (x >> shift_ & kMask);
    if (taken_[cell]) return false;
    taken_[cell] = true;
    return true;
  }

 private:
  static constexpr std::uint32_t kMask = (1u << kCellBits) - 1;
  int shift_;
  std::vector<bool> taken_;
};

/// The number of the node below a node that a place is in.
std::size_t child_of(const Place& place, std::int32_t level) {
  std::size_t child = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    child |= static_cast<std::size_t>(place[axis] >> (kBits - 1 - level) & 1u) << axis;
  }
  return child;
}

OctreeKey child_key(const OctreeKey& key, std::size_t child) {
  OctreeKey out;
  out.level = key.level + 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    out.cell[axis] = key.cell[axis] * 2 + static_cast<std::int32_t>(child >> axis & 1u);
  }
  return out;
}

}  // namespace

/// Records one behind the other: whole blocks on the disk, the rest in memory.
struct OctreeSort::Run {
  std::uint64_t points = 0;
  std::vector<std::uint64_t> blocks;  // their numbers in the file
  std::string rest;
};

/// Runs in one file, whose blocks are used again once they were read.
class OctreeSort::Spill {
 public:
  Spill(const std::filesystem::path& beside, std::size_t record_length)
      : beside_(beside),
        record_length_(record_length),
        block_(std::max<std::size_t>(1, kBlock / record_length) * record_length) {}

  void append(Run* run, const char* record) {
    run->rest.append(record, record_length_);
    ++run->points;
    if (run->rest.size() < block_) return;
    if (!file_) file_ = std::make_unique<detail::UnnamedFile>(beside_);
    std::uint64_t block = blocks_;
    if (free_.empty()) {
      ++blocks_;
    } else {
      block = free_.back();
      free_.pop_back();
    }
    file_->write(block * block_, run->rest.data(), block_);
    run->blocks.push_back(block);
    run->rest.clear();
  }

  void read(Run* run, const std::function<void(const char*, std::size_t)>& use) {
    std::string bytes(run->blocks.empty() ? 0 : block_, '\0');
    for (const std::uint64_t block : run->blocks) {
      file_->read(block * block_, bytes.data(), block_);
      free_.push_back(block);
      use(bytes.data(), block_ / record_length_);
    }
    run->blocks = {};
    if (!run->rest.empty()) use(run->rest.data(), run->rest.size() / record_length_);
    run->rest = {};
  }

 private:
  static constexpr std::size_t kBlock = std::size_t{1} << 18;  // bytes
  std::filesystem::path beside_;
  std::size_t record_length_, block_;
  std::unique_ptr<detail::UnnamedFile> file_;
  std::uint64_t blocks_ = 0;
  std::vector<std::uint64_t> free_;
};

OctreeSort::OctreeSort(const OctreeOptions& options, NodeSink node)
    : options_(options),
      node_(std::move(node)),
      spill_(std::make_unique<Spill>(options.beside, options.record_length)) {
  double finest = options_.cube.side;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double to_places = std::ldexp(1.0, kBits) / options_.cube.side;
    by_step_[axis] = options_.scale[axis] * to_places;
    low_[axis] = (options_.cube.low[axis] - options_.offset[axis]) / options_.scale[axis];
    const double step = std::abs(options_.scale[axis]);
    if (step > 0.0) finest = std::min(finest, step);
  }
  // Nodes no larger than a step: what is in one is at one place.
  while (deepest_ < kMostLevels && std::ldexp(options_.cube.side, -deepest_) > finest) ++deepest_;
}

OctreeSort::~OctreeSort() = default;

Place OctreeSort::place_of(const char* record) const {
  constexpr double kLargest = 2147483647.0;
  Place place;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto steps =
        detail::load<std::int32_t>(reinterpret_cast<const unsigned char*>(record) + 4 * axis);
    const double x = by_step_[axis] * (steps - low_[axis]);
    // Rounding may take points at the cube's faces outside.
    place[axis] = static_cast<std::uint32_t>(x > 0.0 ? std::min(x, kLargest) : 0.0);
  }
  return place;
}

void OctreeSort::sort(std::uint64_t points, const RecordBlocks& input) {
  if (points > 0) sort_subtree({}, points, input);
}

void OctreeSort::sort_subtree(const OctreeKey& key, std::uint64_t points,
                              const RecordBlocks& input) {
  const bool fits = points <= std::max(options_.memory / options_.record_length, kMostInLeaf);
  if (!fits && key.level < deepest_) return split(key, input);
  if (!fits) {
    throw std::invalid_argument(
        "found " + std::to_string(points) + " points at one place, expected at most " +
        std::to_string(options_.memory / options_.record_length) + " for a node of COPC");
  }
  std::string records;
  records.reserve(points * options_.record_length);
  input([&](const char* block, std::size_t count) {
    records.append(block, count * options_.record_length);
  });
  std::vector<std::uint32_t> order(points);
  std::iota(order.begin(), order.end(), 0u);
  divide(key, records, std::move(order));
}

/// A node whose points and those below it memory does not hold.
void OctreeSort::split(const OctreeKey& key, const RecordBlocks& input) {
  std::array<Run, 8> below;
  {
    Occupied occupied(key.level);
    std::string own;
    input([&](const char* block, std::size_t count) {
      throw_if_interrupted();
      for (std::size_t i = 0; i < count; ++i) {
        const char* const record = block + i * options_.record_length;
        const Place place = place_of(record);
        if (occupied.take(place)) {
          own.append(record, options_.record_length);
        } else {
          spill_->append(&below[child_of(place, key.level)], record);
        }
      }
    });
    node_(key, std::move(own));
  }
  for (std::size_t child = 0; child < below.size(); ++child) {
    Run run = std::move(below[child]);
    if (run.points == 0) continue;
    sort_subtree(child_key(key, child), run.points,
                 [&](const auto& use) { spill_->read(&run, use); });
  }
}

void OctreeSort::divide(const OctreeKey& key, const std::string& records,
                        std::vector<std::uint32_t> order) {
  throw_if_interrupted();
  const std::size_t size = options_.record_length;
  const auto give = [&](const std::vector<std::uint32_t>& points) {
    std::string own;
    own.reserve(points.size() * size);
    for (const std::uint32_t i : points) own.append(records, i * size, size);
    node_(key, std::move(own));
  };
  if (order.size() <= kMostInLeaf || key.level == deepest_) return give(order);
  std::array<std::vector<std::uint32_t>, 8> below;
  {
    Occupied occupied(key.level);
    std::vector<std::uint32_t> own;
    for (const std::uint32_t i : order) {
      const Place place = place_of(records.data() + i * size);
      if (occupied.take(place)) {
        own.push_back(i);
      } else {
        below[child_of(place, key.level)].push_back(i);
      }
    }
    order = {};
    give(own);
  }
  for (std::size_t child = 0; child < below.size(); ++child) {
    if (below[child].empty()) continue;
    divide(child_key(key, child), records, std::move(below[child]));
  }
}

}  // namespace camber::laz
