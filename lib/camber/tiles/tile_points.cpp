#include "camber/tiles/tile_points.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>

#include "camber/cloud/las_chunks.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/interruption.h"
#include "camber/core/radix_sort.h"
#include "camber/tiles/detail/kept_parts.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using detail::KeptPart;
using detail::KeptParts;
using detail::KeptPoint;

constexpr double kSteps = 1024.0;                           // a metre
constexpr std::int64_t kMostSteps = std::int64_t{1} << 24;  // that a float holds exactly

constexpr std::uint64_t kMostPoints = std::numeric_limits<std::int32_t>::max();

/// Places in steps from zero, or from an origin.
using Steps = std::array<std::int64_t, 3>;

struct GridPoint {
  std::int32_t x = 0, y = 0, z = 0;  // steps from the origin
  std::int32_t own = -1;
  std::uint8_t kind = 0, flags = 0;
};

/// Of x and y, both ends included; empty as made.
struct StepBox {
  std::array<std::int64_t, 2> low{std::numeric_limits<std::int64_t>::max(),
                                  std::numeric_limits<std::int64_t>::max()};
  std::array<std::int64_t, 2> high{std::numeric_limits<std::int64_t>::min(),
                                   std::numeric_limits<std::int64_t>::min()};

  void extend(const Steps& p) {
    for (std::size_t a = 0; a < 2; ++a) {
      low[a] = std::min(low[a], p[a]);
      high[a] = std::max(high[a], p[a]);
    }
  }
  /// @param by  m; a box with a place
  void grow(double by) {
    const auto steps = static_cast<std::int64_t>(std::ceil(by * kSteps));
    for (std::size_t a = 0; a < 2; ++a) {
      low[a] -= steps;
      high[a] += steps;
    }
  }
  bool contains(const Steps& p) const {
    return p[0] >= low[0] && p[0] <= high[0] && p[1] >= low[1] && p[1] <= high[1];
  }
};

class Reader {
 public:
  /// @param records  whether the points' records are kept
  Reader(const TilePlan& plan, const TileReading& reading, bool records = false)
      : plan_(plan), reading_(reading), keep_records_(records) {
    options_.num_threads = reading.num_threads;
    if (records) return;
    options_.attributes = std::vector<std::string>();
    if (reading.classes) options_.attributes = {"classification", "class_flags"};
  }

  std::int64_t steps(double value, std::size_t axis) const {
    const double metres = value * (axis < 2 ? plan_.metres : plan_.height_metres);
    return std::llround(metres * kSteps);
  }

  std::int64_t multiple() const { return std::llround(reading_.alignment * kSteps); }
  /// The next multiple of the alignment that is not above.
  std::int64_t below(std::int64_t v) const {
    const std::int64_t m = multiple();
    return (v >= 0 ? v / m : -((-v + m - 1) / m)) * m;
  }

  /// Sets the origin, below a place in plan.
  void set_origin(double x, double y) {
    origin_ = {below(steps(x, 0)), below(steps(y, 1)), std::llround(plan_.height_zero * kSteps)};
  }

  void set_origin(const Eigen::Vector3d& origin) {
    for (std::size_t a = 0; a < 3; ++a) {
      origin_[a] = std::llround(origin[static_cast<Eigen::Index>(a)] * kSteps);
    }
  }

  void read_own(const fs::path& path) {
    const std::unique_ptr<PointSource> source = open_point_source(path, options_);
    require_few(source->header().count.value_or(0), path);
    read(*source, path, true, nullptr);
    out_.own_points = out_.read_points;
  }

  void read_own(std::size_t tile) {
    const fs::path path = plan_.path_of(tile);
    const std::vector<TilePart> parts = reading_.kept ? read_tile_parts(plan_, tile) : no_parts();
    std::uint64_t points = 0;
    for (const TilePart& part : parts) points += part.points;
    if (parts.size() < 2 || points != plan_.tiles[tile].points) return read_own(path);
    require_few(points, path);
    items_.reserve(static_cast<std::size_t>(points));
    std::vector<std::size_t> chunks(parts.size());
    std::iota(chunks.begin(), chunks.end(), std::size_t{0});
    read_parts(tile, parts, chunks, true, nullptr);
    out_.own_points = points;
  }

  /// Of another tile those within the box.
  void read_around(std::size_t tile, const StepBox& box) {
    const fs::path path = plan_.path_of(tile);
    const std::vector<TilePart> parts = read_tile_parts(plan_, tile);
    if (parts.size() < 2) return read(*open_point_source(path, options_), path, false, &box);
    std::vector<std::size_t> chunks;
    for (std::size_t k = 0; k < parts.size(); ++k) {
      if (parts[k].points > 0 && meets(parts[k].box, box)) chunks.push_back(k);
    }
    if (reading_.kept) return read_parts(tile, parts, chunks, false, &box);
    if (!chunks.empty()) read(*open_las_chunks(path, options_, chunks), path, false, &box);
  }

  bool meets(const Eigen::AlignedBox2d& bounds, const StepBox& box) const {
    for (std::size_t a = 0; a < 2; ++a) {
      const auto axis = static_cast<Eigen::Index>(a);
      if (steps(bounds.max()[axis], a) < box.low[a]) return false;
      if (steps(bounds.min()[axis], a) > box.high[a]) return false;
    }
    return true;
  }

  /// Where the tile's own points lie, and as much as the halo beside them.
  StepBox with_halo() const {
    StepBox box;
    for (const GridPoint& p : items_) {
      box.extend({origin_[0] + p.x, origin_[1] + p.y, 0});
    }
    if (reading_.whole_squares && !items_.empty()) {
      for (std::size_t a = 0; a < 2; ++a) {
        box.low[a] = below(box.low[a]);
        box.high[a] = below(box.high[a]) + multiple() - 1;
      }
    }
    box.grow(reading_.halo);
    return box;
  }

  TilePoints finish();
  TileRecords finish_records();

 private:
  static std::vector<TilePart> no_parts() { return {}; }
  static void require_few(std::uint64_t points, const fs::path& path) {
    if (points <= kMostPoints) return;
    throw NoAnswerError(path.string() +
                        ": the tile has more than 2^31 points; expected smaller "
                        "tiles (--tile)");
  }
  void take_header(const PointStreamHeader& header, const fs::path& path);
  void read(PointSource& source, const fs::path& path, bool own, const StepBox* box);
  void read_parts(std::size_t tile, const std::vector<TilePart>& parts,
                  const std::vector<std::size_t>& chunks, bool own, const StepBox* box);
  bool take(const Steps& place, std::uint8_t kind, std::uint8_t flags, std::int32_t number,
            bool own, const StepBox* box, const fs::path& path);
  std::optional<StepBox> next_box() const;
  std::vector<std::uint32_t> order() const;

  const TilePlan& plan_;
  const TileReading& reading_;
  ReadOptions options_;
  bool keep_records_;
  Steps origin_{};
  std::vector<GridPoint> items_;
  PointStreamHeader header_;  // of the first file, where records are kept
  std::string records_;
  TilePoints out_;
};

/// The points of a source one by one, in steps from zero.
class Decoder {
 public:
  Decoder(const Reader& reader, PointSource& source, const fs::path& path)
      : reader_(reader), source_(source), fields_(source.header().fields), path_(path) {
    position_ = find_roles(fields_).position;
    for (std::size_t f = 0; f < fields_.size(); ++f) {
      if (fields_[f].name == "classification") kind_ = static_cast<int>(f);
      if (fields_[f].name == "class_flags") flags_ = static_cast<int>(f);
    }
  }

  /// @return false after the last one
  bool next() {
    ++place_;
    if (++at_ < batch_.count) return true;
    do {
      throw_if_interrupted();
      if (!source_.next(batch_)) return false;
    } while (batch_.count == 0);
    at_ = 0;
    return true;
  }
  std::int32_t place() const { return place_; }  ///< of the point in the source, from 0
  Steps steps() const {
    Steps out{};
    for (std::size_t a = 0; a < 3; ++a) {
      const double value = position_[a] < 0 ? 0.0 : number(position_[a]);
      if (!(std::abs(value) < 1e12)) {
        throw InputError(path_.string(), fmt::format("point {} has the coordinate {}, expected one "
                                                     "within 1e12 of 0",
                                                     place_, value));
      }
      out[a] = reader_.steps(value, a);
    }
    return out;
  }
  std::uint8_t kind() const { return byte(kind_); }
  std::uint8_t flags() const { return byte(flags_); }
  const char* record() const {
    return reinterpret_cast<const char*>(batch_.records.data + at_ * batch_.records.stride);
  }

 private:
  double number(int field) const {
    const auto f = static_cast<std::size_t>(field);
    return batch_.fields[f].number(fields_[f].type, at_);
  }
  std::uint8_t byte(int field) const {
    return field < 0 ? std::uint8_t{0}
                     : static_cast<std::uint8_t>(std::clamp(number(field), 0.0, 255.0));
  }

  const Reader& reader_;
  PointSource& source_;
  const std::vector<PointField>& fields_;
  const fs::path& path_;
  std::array<int, 3> position_{};
  int kind_ = -1, flags_ = -1;
  PointBatch batch_;
  std::size_t at_ = 0;
  std::int32_t place_ = -1;
};

/// Takes a point that lies in the box. @return whether it does
bool Reader::take(const Steps& place, std::uint8_t kind, std::uint8_t flags, std::int32_t number,
                  bool own, const StepBox* box, const fs::path& path) {
  if (box && !box->contains(place)) return false;
  Steps p = place;
  for (std::size_t a = 0; a < 3; ++a) p[a] -= origin_[a];
  if (std::abs(p[2]) >= kMostSteps) return false;  // a height of nothing on Earth
  for (std::size_t a = 0; a < 2; ++a) {
    if (std::abs(p[a]) < kMostSteps) continue;
    throw NoAnswerError(fmt::format(
        "{}: point {} lies more than 16 km from others of its tile; expected smaller tiles "
        "(--tile), and no points astray (camber filter)",
        path.string(), number));
  }
  GridPoint item;
  item.x = static_cast<std::int32_t>(p[0]);
  item.y = static_cast<std::int32_t>(p[1]);
  item.z = static_cast<std::int32_t>(p[2]);
  if (own) item.own = number;
  item.kind = kind;
  item.flags = flags;
  items_.push_back(item);
  return true;
}

void Reader::read(PointSource& source, const fs::path& path, bool own, const StepBox* box) {
  const PointStreamHeader& header = source.header();
  if (keep_records_) take_header(header, path);
  if (own && header.count) {
    items_.reserve(static_cast<std::size_t>(std::min(*header.count, header.most_reserved)));
  }
  for (Decoder point(*this, source, path); point.next();) {
    ++out_.read_points;
    const bool taken =
        take(point.steps(), point.kind(), point.flags(), point.place(), own, box, path);
    if (taken && keep_records_) records_.append(point.record(), header_.las->record_length);
  }
}

/// Of a tile's parts some, in the order of the file; those that the tile before left are not
/// decoded again.
void Reader::read_parts(std::size_t tile, const std::vector<TilePart>& parts,
                        const std::vector<std::size_t>& chunks, bool own, const StepBox* box) {
  KeptParts& kept = *reading_.kept;
  const fs::path path = plan_.path_of(tile);
  std::vector<std::size_t> missing;
  for (const std::size_t k : chunks) {
    if (!kept.find({tile, k})) missing.push_back(k);
  }
  std::unique_ptr<PointSource> source;
  if (missing.size() == parts.size()) {
    source = open_point_source(path, options_);
  } else if (!missing.empty()) {
    source = open_las_chunks(path, options_, missing);
  }
  std::optional<Decoder> point;
  if (source) point.emplace(*this, *source, path);
  const std::optional<StepBox> next = next_box();
  std::uint64_t first = 0;  // point of the file
  std::size_t part = 0;
  for (const std::size_t k : chunks) {
    for (; part < k; ++part) first += parts[part].points;
    const bool needed = next && parts[k].points > 0 && meets(parts[k].box, *next);
    const auto number = [&](std::uint64_t i) { return static_cast<std::int32_t>(first + i); };
    if (const KeptPart* const there = kept.find({tile, k})) {
      for (std::size_t i = 0; i < there->points.size(); ++i) {
        const KeptPoint& p = there->points[i];
        take({there->origin[0] + p.x, there->origin[1] + p.y, there->origin[2] + p.z}, p.kind,
             p.flags, number(i), own, box, path);
      }
      if (needed) kept.leave_again({tile, k});
      continue;
    }
    KeptPart left;
    bool fits = needed;
    if (needed) left.points.reserve(static_cast<std::size_t>(parts[k].points));
    for (std::uint64_t i = 0; i < parts[k].points; ++i) {
      if (!point || !point->next()) {
        throw InputError(path.string(), fmt::format("found {} points in a part, expected the {} "
                                                    "of the plan",
                                                    i, parts[k].points));
      }
      ++out_.read_points;
      const Steps place = point->steps();
      take(place, point->kind(), point->flags(), number(i), own, box, path);
      if (!fits) continue;
      if (i == 0) left.origin = {place[0], place[1], origin_[2]};
      std::array<std::int32_t, 3> offset{};
      for (std::size_t a = 0; a < 3; ++a) {
        std::int64_t by = place[a] - left.origin[a];
        if (a == 2) by = std::clamp(by, -kMostSteps, kMostSteps);  // which is not taken
        fits = fits && std::abs(by) <= std::numeric_limits<std::int32_t>::max();
        offset[a] = static_cast<std::int32_t>(by);
      }
      left.points.push_back({offset[0], offset[1], offset[2], point->kind(), point->flags()});
    }
    if (fits) kept.leave({tile, k}, std::move(left));
  }
}

/// Where the tile that is read after this one may need points; nothing where there is none.
std::optional<StepBox> Reader::next_box() const {
  if (!reading_.kept || reading_.kept->next() >= plan_.tiles.size()) return std::nullopt;
  const Eigen::AlignedBox3d& bounds = plan_.tiles[reading_.kept->next()].bounds;
  StepBox box;
  for (const Eigen::Vector3d& corner : {bounds.min(), bounds.max()}) {
    box.extend({steps(corner.x(), 0), steps(corner.y(), 1), 0});
  }
  box.grow(reading_.halo + (reading_.whole_squares ? reading_.alignment : 0.0));
  return box;
}

void Reader::take_header(const PointStreamHeader& header, const fs::path& path) {
  if (!header_.las) {
    header_ = header;
    return;
  }
  const LasFile &a = *header_.las, &b = *header.las;
  if (a.point_format == b.point_format && a.record_length == b.record_length &&
      a.scale == b.scale && a.offset == b.offset) {
    return;
  }
  throw InputError(path.string(),
                   "found points of another format, or on another grid, than the "
                   "tile beside it; expected a plan that was not made in place");
}

/// By y, x, height: a radix sort. Points at one place count alike, whatever their order.
std::vector<std::uint32_t> Reader::order() const {
  struct Item {
    std::uint64_t code;
    std::uint32_t index;
  };
  std::array<std::int32_t, 3> low{INT32_MAX, INT32_MAX, INT32_MAX};
  std::array<std::int32_t, 3> high{INT32_MIN, INT32_MIN, INT32_MIN};
  for (const GridPoint& p : items_) {
    const std::array<std::int32_t, 3> v{p.z, p.x, p.y};
    for (std::size_t a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], v[a]);
      high[a] = std::max(high[a], v[a]);
    }
  }
  std::array<int, 3> bits{};
  for (std::size_t a = 0; a < 3 && !items_.empty(); ++a) {
    while (((std::int64_t{high[a]} - low[a]) >> bits[a]) != 0) ++bits[a];
  }
  std::vector<Item> items(items_.size());
  for (std::size_t i = 0; i < items.size(); ++i) items[i].index = static_cast<std::uint32_t>(i);
  const auto sort_by = [&](int all, const auto& code_of) {
    for (Item& item : items) item.code = code_of(items_[item.index]);
    radix_sort(&items, all);
  };
  const auto above = [](std::int32_t v, std::int32_t least) {
    return static_cast<std::uint64_t>(std::int64_t{v} - least);
  };
  sort_by(bits[0], [&](const GridPoint& p) { return above(p.z, low[0]); });
  sort_by(bits[1] + bits[2],
          [&](const GridPoint& p) { return above(p.x, low[1]) | above(p.y, low[2]) << bits[1]; });
  std::vector<std::uint32_t> out;
  out.reserve(items.size());
  for (const Item& item : items) out.push_back(item.index);
  return out;
}

TilePoints Reader::finish() {
  const std::vector<std::uint32_t> sorted = order();
  out_.cloud.frame = CloudFrame::kZUp;
  for (std::size_t a = 0; a < 3; ++a) {
    out_.cloud.origin[static_cast<Eigen::Index>(a)] = static_cast<double>(origin_[a]) / kSteps;
  }
  out_.cloud.points.resize(items_.size());
  out_.own.resize(items_.size());
  if (reading_.classes) {
    out_.classes.resize(items_.size());
    out_.flags.resize(items_.size());
  }
  constexpr float kStep = 1.0f / 1024.0f;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const GridPoint& p = items_[sorted[i]];
    out_.cloud.points[i] = {static_cast<float>(p.x) * kStep, static_cast<float>(p.y) * kStep,
                            static_cast<float>(p.z) * kStep};
    out_.own[i] = p.own;
    if (!reading_.classes) continue;
    out_.classes[i] = p.kind;
    out_.flags[i] = p.flags;
  }
  return std::move(out_);
}

TileRecords Reader::finish_records() {
  const std::vector<std::uint32_t> sorted = order();
  TileRecords out;
  out.order.assign(sorted.begin(), sorted.end());
  const std::size_t size = header_.las ? header_.las->record_length : 0;
  const auto bytes = [&](int i) { return records_.data() + static_cast<std::size_t>(i) * size; };
  const auto same_place = [&](int a, int b) {
    const GridPoint &p = items_[static_cast<std::size_t>(a)],
                    &q = items_[static_cast<std::size_t>(b)];
    return p.x == q.x && p.y == q.y && p.z == q.z;
  };
  for (auto begin = out.order.begin(); begin != out.order.end();) {
    auto end = begin;
    while (end != out.order.end() && same_place(*begin, *end)) ++end;
    std::sort(begin, end, [&](int a, int b) { return std::memcmp(bytes(a), bytes(b), size) < 0; });
    begin = end;
  }
  for (const int i : out.order) {
    out.own.push_back(items_[static_cast<std::size_t>(i)].own >= 0 ? 1 : 0);
  }
  out.header = header_;
  out.records = std::move(records_);
  out.own_points = out_.own_points;
  out.read_points = out_.read_points;
  return out;
}

void check_file(const TilePlan& plan, std::size_t tile, bool content) {
  const Tile& t = plan.tiles[tile];
  const fs::path path = plan.path_of(tile);
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(path, error);
  if (error) throw InputError(path.string(), error.message() + ", expected a tile of the plan");
  if (bytes != t.bytes) {
    throw InputError(path.string(),
                     fmt::format("found {} bytes, expected the {} of the plan", bytes, t.bytes));
  }
  if (content && hash_file(path) != t.hash) {
    throw InputError(path.string(), "found other content than the plan was made with");
  }
}

}  // namespace

namespace {

/// Of all tiles but one what lies within a box.
void read_within(const TilePlan& plan, std::size_t but, const StepBox& box, Reader& reader) {
  for (std::size_t k = 0; k < plan.tiles.size(); ++k) {
    const Eigen::AlignedBox3d& b = plan.tiles[k].bounds;
    const Eigen::AlignedBox2d plan_box(b.min().head<2>(), b.max().head<2>());
    if (k == but || !reader.meets(plan_box, box)) continue;
    check_file(plan, k, false);
    reader.read_around(k, box);
  }
}

void read_with_halo(const TilePlan& plan, std::size_t tile, const TileReading& reading,
                    Reader& reader) {
  const Tile& own = plan.tiles.at(tile);
  check_file(plan, tile, true);
  reader.set_origin(own.bounds.min().x(), own.bounds.min().y());
  reader.read_own(tile);
  if (reading.halo > 0.0) read_within(plan, tile, reader.with_halo(), reader);
  if (reading.kept) reading.kept->turn();
}

}  // namespace

TilePoints read_tile_points(const TilePlan& plan, std::size_t tile, const TileReading& reading) {
  Reader reader(plan, reading);
  read_with_halo(plan, tile, reading, reader);
  return reader.finish();
}

TilePoints read_points_around(const TilePlan& plan, const TilePoints& around,
                              const TileReading& reading) {
  Reader reader(plan, reading);
  reader.set_origin(around.cloud.origin);
  StepBox box;
  for (std::size_t i = 0; i < around.own.size(); ++i) {
    if (around.own[i] < 0) continue;
    const Eigen::Vector3d p =
        (around.cloud.origin + around.cloud.points[i].cast<double>()) * kSteps;
    box.extend({std::llround(p.x()), std::llround(p.y()), 0});
  }
  box.grow(reading.halo);
  read_within(plan, plan.tiles.size(), box, reader);
  return reader.finish();
}

TileRecords read_tile_records(const TilePlan& plan, std::size_t tile, const TileReading& reading) {
  Reader reader(plan, reading, true);
  read_with_halo(plan, tile, reading, reader);
  return reader.finish_records();
}

std::unique_ptr<PointSource> open_tile_within(const TilePlan& plan, std::size_t tile,
                                              const fs::path& path, const Eigen::AlignedBox2d& box,
                                              const ReadOptions& options) {
  const std::vector<TilePart> parts = read_tile_parts(plan, tile);
  std::vector<std::uint64_t> counts;
  std::vector<std::size_t> chunks;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    counts.push_back(parts[k].points);
    if (parts[k].points > 0 && parts[k].box.intersects(box)) chunks.push_back(k);
  }
  if (!parts.empty() && chunks.empty()) return nullptr;
  std::unique_ptr<PointSource> whole = open_point_source(path, options);
  const std::shared_ptr<const LasFile> las = whole->header().las;
  if (parts.size() < 2 || chunks.size() == parts.size() || !las || las_chunks(*las) != counts) {
    return whole;
  }
  return open_las_chunks(path, options, chunks);
}

TilePoints read_whole_points(const TilePlan& plan, const fs::path& file,
                             const TileReading& reading) {
  Reader reader(plan, reading);
  reader.set_origin(plan.bounds.min().x(), plan.bounds.min().y());
  reader.read_own(file);
  return reader.finish();
}

}  // namespace camber
