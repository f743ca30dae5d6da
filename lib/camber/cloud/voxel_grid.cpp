#include "camber/cloud/voxel_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace camber {
namespace {

/// An array that grows by blocks, so that growing neither copies nor doubles it.
template <typename T>
class Blocks {
 public:
  T& operator[](std::size_t i) { return blocks_[i >> kShift][i & (kBlock - 1)]; }
  void grow_to(std::size_t size) {
    while (blocks_.size() * kBlock < size) blocks_.push_back(std::make_unique<T[]>(kBlock));
  }

 private:
  static constexpr int kShift = 14;
  static constexpr std::size_t kBlock = std::size_t{1} << kShift;
  std::vector<std::unique_ptr<T[]>> blocks_;
};

struct Cell {
  std::int32_t x, y, z;
  std::int32_t id;  // -1: free
};

struct Voxel {
  double sum[3] = {0.0, 0.0, 0.0};
  std::uint32_t count = 0;
};

/// Majority vote in constant memory (Boyer and Moore, "MJRTY", 1981).
struct Vote {
  std::int64_t value = 0;
  std::uint64_t lead = 0;

  void add(std::int64_t v) {
    if (lead == 0) {
      value = v;
      lead = 1;
    } else {
      lead = v == value ? lead + 1 : lead - 1;
    }
  }
};

enum class Rule { kPosition, kMean, kVote, kPackedColor, kSigma, kCovariance, kNormal };

struct Attribute {
  std::size_t field = 0;
  Rule rule = Rule::kMean;
  int axis = 0;                          // kPosition
  Blocks<double> sums;                   // kMean, kSigma, kCovariance, kNormal
  Blocks<Vote> votes;                    // kVote
  Blocks<std::array<double, 3>> colors;  // kPackedColor
};

std::int32_t cell_of(double x, double inverse_size) {
  const double cell = std::floor(x * inverse_size);
  return static_cast<std::int32_t>(std::clamp(cell, -2147483648.0, 2147483647.0));
}

std::size_t hash(std::int32_t x, std::int32_t y, std::int32_t z) {
  std::uint64_t h = static_cast<std::uint32_t>(x) * 0x9E3779B97F4A7C15ull;
  h = (h ^ static_cast<std::uint32_t>(y)) * 0xC2B2AE3D27D4EB4Full;
  h = (h ^ (h >> 29) ^ static_cast<std::uint32_t>(z)) * 0x165667B19E3779F9ull;
  return static_cast<std::size_t>(h ^ (h >> 32));
}

}  // namespace

struct VoxelGrid::State {
  PointStreamHeader header;
  double inverse_size = 1.0;
  FieldRoles roles;
  std::vector<Attribute> attributes;  // all but the position
  std::vector<Cell> table;
  std::size_t count = 0;
  Blocks<Voxel> voxels;
  std::uint64_t non_finite = 0;

  // Of one batch.
  std::array<std::vector<double>, 3> position;
  std::vector<std::array<std::int32_t, 3>> cells;
  std::vector<std::size_t> slots;
  std::vector<std::int32_t> ids;

  void grow();
  std::int32_t find(const std::array<std::int32_t, 3>& cell, std::size_t start);
};

VoxelGrid::VoxelGrid(const PointStreamHeader& header, double size)
    : state_(std::make_unique<State>()) {
  if (!(std::isfinite(size) && size > 0.0)) {
    throw std::invalid_argument("voxel size = " + std::to_string(size) +
                                ", expected a positive number of metres");
  }
  State& s = *state_;
  s.header = header;
  s.header.width = s.header.height = 0;
  s.inverse_size = 1.0 / size;
  s.roles = find_roles(header.fields);
  s.table.assign(std::size_t{1} << 12, {0, 0, 0, -1});
  const auto is_in = [](const auto& group, int field) {
    return std::find(group.begin(), group.end(), field) != group.end();
  };
  for (std::size_t f = 0; f < header.fields.size(); ++f) {
    const int field = static_cast<int>(f);
    if (is_in(s.roles.position, field)) continue;
    Attribute attribute;
    attribute.field = f;
    if (is_in(s.roles.color, field)) {
      attribute.rule = Rule::kMean;
    } else if (field == s.roles.packed_color) {
      attribute.rule = Rule::kPackedColor;
    } else if (is_in(s.roles.normal, field)) {
      attribute.rule = Rule::kNormal;
    } else if (field == s.roles.sigma) {
      attribute.rule = Rule::kSigma;
    } else if (is_in(s.roles.covariance, field)) {
      attribute.rule = Rule::kCovariance;
    } else {
      attribute.rule = is_float(header.fields[f].type) ? Rule::kMean : Rule::kVote;
    }
    s.attributes.push_back(std::move(attribute));
  }
}

VoxelGrid::~VoxelGrid() = default;

const std::vector<std::int32_t>& VoxelGrid::cubes() const { return state_->ids; }

std::uint64_t VoxelGrid::non_finite() const { return state_->non_finite; }

void VoxelGrid::State::grow() {
  std::vector<Cell> larger(2 * table.size(), {0, 0, 0, -1});
  const std::size_t mask = larger.size() - 1;
  for (const Cell& cell : table) {
    if (cell.id < 0) continue;
    std::size_t slot = hash(cell.x, cell.y, cell.z) & mask;
    while (larger[slot].id >= 0) slot = (slot + 1) & mask;
    larger[slot] = cell;
  }
  table.swap(larger);
}

std::int32_t VoxelGrid::State::find(const std::array<std::int32_t, 3>& cell, std::size_t start) {
  const std::size_t mask = table.size() - 1;
  for (std::size_t slot = start & mask;; slot = (slot + 1) & mask) {
    Cell& at = table[slot];
    if (at.id >= 0) {
      if (at.x == cell[0] && at.y == cell[1] && at.z == cell[2]) return at.id;
      continue;
    }
    at = {cell[0], cell[1], cell[2], static_cast<std::int32_t>(count)};
    return static_cast<std::int32_t>(count++);
  }
}

void VoxelGrid::add(const PointBatch& batch) {
  State& s = *state_;
  const std::size_t n = batch.count;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    s.position[axis].assign(n, 0.0);
    const int field = s.roles.position[axis];
    if (field < 0) continue;
    const FieldView view = batch.fields[static_cast<std::size_t>(field)];
    with_type(s.header.fields[static_cast<std::size_t>(field)].type, [&](auto tag) {
      for (std::size_t i = 0; i < n; ++i) {
        s.position[axis][i] = static_cast<double>(view.template get<decltype(tag)>(i));
      }
    });
  }
  // Room for all of the batch, so that slots stay where they are.
  while (2 * (s.count + n) > s.table.size()) s.grow();
  if (s.count + n > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    throw std::invalid_argument("more than 2147483647 voxels, expected larger ones");
  }
  s.cells.resize(n);
  s.slots.resize(n);
  s.ids.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double x = s.position[0][i], y = s.position[1][i], z = s.position[2][i];
    if (!(std::isfinite(x) && std::isfinite(y) && std::isfinite(z))) {
      s.ids[i] = -1;
      ++s.non_finite;
      continue;
    }
    s.ids[i] = 0;
    s.cells[i] = {cell_of(x, s.inverse_size), cell_of(y, s.inverse_size),
                  cell_of(z, s.inverse_size)};
    s.slots[i] = hash(s.cells[i][0], s.cells[i][1], s.cells[i][2]);
  }
  // The table is larger than the caches: ask for what comes next while looking for this.
  constexpr std::size_t kAhead = 24;
  const std::size_t mask = s.table.size() - 1;
  for (std::size_t i = 0; i < n; ++i) {
    if (i + kAhead < n) __builtin_prefetch(&s.table[s.slots[i + kAhead] & mask], 1);
    if (s.ids[i] >= 0) s.ids[i] = s.find(s.cells[i], s.slots[i]);
  }
  s.voxels.grow_to(s.count);
  for (std::size_t i = 0; i < n; ++i) {
    if (i + kAhead < n && s.ids[i + kAhead] >= 0) {
      __builtin_prefetch(&s.voxels[static_cast<std::size_t>(s.ids[i + kAhead])], 1);
    }
    if (s.ids[i] < 0) continue;
    Voxel& voxel = s.voxels[static_cast<std::size_t>(s.ids[i])];
    voxel.sum[0] += s.position[0][i];
    voxel.sum[1] += s.position[1][i];
    voxel.sum[2] += s.position[2][i];
    ++voxel.count;
  }
  for (Attribute& attribute : s.attributes) {
    const FieldView view = batch.fields[attribute.field];
    const ScalarType type = s.header.fields[attribute.field].type;
    if (attribute.rule == Rule::kVote) {
      attribute.votes.grow_to(s.count);
      with_type(type, [&](auto tag) {
        for (std::size_t i = 0; i < n; ++i) {
          if (s.ids[i] < 0) continue;
          attribute.votes[static_cast<std::size_t>(s.ids[i])].add(
              static_cast<std::int64_t>(view.template get<decltype(tag)>(i)));
        }
      });
    } else if (attribute.rule == Rule::kPackedColor) {
      attribute.colors.grow_to(s.count);
      for (std::size_t i = 0; i < n; ++i) {
        if (s.ids[i] < 0) continue;
        const std::uint32_t rgb = view.get<std::uint32_t>(i);
        auto& sum = attribute.colors[static_cast<std::size_t>(s.ids[i])];
        for (std::size_t c = 0; c < 3; ++c) sum[c] += rgb >> (16 - 8 * c) & 255u;
      }
    } else {
      attribute.sums.grow_to(s.count);
      const bool squared = attribute.rule == Rule::kSigma;
      const bool known_alone = attribute.rule == Rule::kNormal;  // a point may have none
      with_type(type, [&](auto tag) {
        for (std::size_t i = 0; i < n; ++i) {
          if (s.ids[i] < 0) continue;
          const double value = static_cast<double>(view.template get<decltype(tag)>(i));
          if (known_alone && std::isnan(value)) continue;
          attribute.sums[static_cast<std::size_t>(s.ids[i])] += squared ? value * value : value;
        }
      });
    }
  }
}

namespace {

/// A mean as a value of its field's type; of integers the nearest.
template <typename T>
T mean_value(double value) {
  if constexpr (std::is_floating_point_v<T>) {
    return static_cast<T>(value);
  } else {
    return static_cast<T>(std::floor(value + 0.5));  // between values of T, so in its range
  }
}

}  // namespace

class VoxelGrid::Source : public PointSource {
 public:
  explicit Source(State& grid) : s_(grid) {
    header_ = s_.header;
    header_.records = false;  // means are no records
    header_.count = s_.count;
    header_.grid.reset();
    report_.declared = s_.count;
    columns_.resize(header_.fields.size());
  }

  bool next(PointBatch& batch) override {
    const std::size_t n = std::min(kBatchSize, s_.count - done_);
    batch.count = n;
    batch.fields.assign(header_.fields.size(), {});
    if (n == 0) return false;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int field = s_.roles.position[axis];
      if (field < 0) continue;
      fill(batch, static_cast<std::size_t>(field), n, [&](std::size_t id) {
        const Voxel& voxel = s_.voxels[id];
        return voxel.sum[axis] / voxel.count;
      });
    }
    for (Attribute& attribute : s_.attributes) {
      fill_attribute(batch, attribute, n);
    }
    done_ += n;
    report_.points = done_;
    return true;
  }

 private:
  template <typename Value>
  void fill(PointBatch& batch, std::size_t field, std::size_t n, Value&& value) {
    std::vector<unsigned char>& column = columns_[field];
    with_type(header_.fields[field].type, [&](auto tag) {
      using T = decltype(tag);
      column.resize(n * sizeof(T));
      for (std::size_t i = 0; i < n; ++i) {
        const T out = mean_value<T>(value(done_ + i));
        std::memcpy(column.data() + i * sizeof(T), &out, sizeof(T));
      }
      batch.fields[field].data = column.data();
      batch.fields[field].stride = sizeof(T);
    });
  }

  void fill_attribute(PointBatch& batch, Attribute& attribute, std::size_t n) {
    const std::size_t field = attribute.field;
    const auto count = [&](std::size_t id) { return static_cast<double>(s_.voxels[id].count); };
    switch (attribute.rule) {
      case Rule::kVote: {
        std::vector<unsigned char>& column = columns_[field];
        with_type(header_.fields[field].type, [&](auto tag) {
          using T = decltype(tag);
          column.resize(n * sizeof(T));
          for (std::size_t i = 0; i < n; ++i) {
            const T out = static_cast<T>(attribute.votes[done_ + i].value);
            std::memcpy(column.data() + i * sizeof(T), &out, sizeof(T));
          }
          batch.fields[field].data = column.data();
          batch.fields[field].stride = sizeof(T);
        });
        break;
      }
      case Rule::kPackedColor:
        fill(batch, field, n, [&](std::size_t id) {
          double rgb = 0.0;
          for (const double sum : attribute.colors[id]) {
            rgb = 256.0 * rgb + std::floor(sum / count(id) + 0.5);
          }
          return rgb;
        });
        break;
      case Rule::kSigma:
        fill(batch, field, n,
             [&](std::size_t id) { return std::sqrt(attribute.sums[id]) / count(id); });
        break;
      case Rule::kCovariance:
        fill(batch, field, n,
             [&](std::size_t id) { return attribute.sums[id] / (count(id) * count(id)); });
        break;
      case Rule::kNormal:
        fill(batch, field, n, [&](std::size_t id) {
          double squares = 0.0;
          for (Attribute& other : s_.attributes) {
            if (other.rule == Rule::kNormal) squares += other.sums[id] * other.sums[id];
          }
          return squares > 0.0 ? attribute.sums[id] / std::sqrt(squares)
                               : std::numeric_limits<double>::quiet_NaN();
        });
        break;
      case Rule::kPosition:
      case Rule::kMean:
        fill(batch, field, n, [&](std::size_t id) { return attribute.sums[id] / count(id); });
        break;
    }
  }

  State& s_;
  std::size_t done_ = 0;
  std::vector<std::vector<unsigned char>> columns_;
};

std::unique_ptr<PointSource> VoxelGrid::points() { return std::make_unique<Source>(*state_); }

RoadCloud thin(const RoadCloud& cloud, double size) {
  const std::unique_ptr<PointSource> source = make_point_source(cloud);
  VoxelGrid grid(source->header(), size);
  PointBatch batch;
  while (source->next(batch)) grid.add(batch);
  const std::unique_ptr<PointSource> thinned = grid.points();
  CloudBuilder builder(thinned->header(), false);
  while (thinned->next(batch)) builder.add(batch);
  ReadReport report;
  RoadCloud out = builder.finish(report);
  // Empty clouds have no batch to take it from.
  out.origin = cloud.origin;
  return out;
}

}  // namespace camber
