#include "camber/cloud/detail/laz/copc.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <set>
#include <tuple>
#include <vector>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/laz_format.h"

namespace camber::laz {
namespace {

constexpr std::size_t kInfoSize = 160, kEntrySize = 32;
constexpr std::int32_t kDeepest = 30;  // cells of one more have no room in 32 bits

struct Page {
  std::uint64_t start = 0, size = 0;
};

struct Info {
  std::array<double, 3> centre{};
  double half_size = 0.0, spacing = 0.0;
  Page root;
};

template <typename T>
T load(const std::string& bytes, std::size_t at) {
  return detail::load<T>(reinterpret_cast<const unsigned char*>(bytes.data()) + at);
}

const LasRecord* find_info(const LasFile& las) {
  for (const LasRecord& record : las.records) {
    if (record.user_id == kCopcUser && record.record_id == 1 && !record.extended &&
        record.length >= kInfoSize) {
      return &record;
    }
  }
  return nullptr;
}

using Cell = std::array<std::int32_t, 3>;

/// Walks through the whole index, so that what it lacks is known for any query.
class NodeSearch {
 public:
  NodeSearch(const LasFile& las, const CopcQuery& query, bool lenient)
      : las_(las),
        file_(*las.bytes),
        query_(query),
        lenient_(lenient),
        layout_(*las.laz),
        named_(layout_.chunks.size(), false),
        wanted_(layout_.chunks.size(), false) {}

  /// @return the chunks of the nodes that are asked for, in the order of the file
  std::vector<LazChunk> find(std::vector<std::string>* notes);

 private:
  void read_info();
  void read_page(const Page& page);
  void read_entry(const std::string& bytes, std::size_t at, std::uint64_t place);
  void take_node(const LazChunk& chunk, bool wanted, std::uint64_t place);
  void damage(std::uint64_t place, const std::string& reason);
  std::optional<std::uint64_t> first_repeated_node();
  void judge_unnamed(std::vector<std::string>* notes);
  bool wanted(std::int32_t level, const Cell& cell) const;

  struct Key {
    std::int32_t level = 0;
    Cell cell{};
    std::uint64_t place = 0;  // of its entry in the file

    bool same_node(const Key& other) const { return level == other.level && cell == other.cell; }
    bool operator<(const Key& other) const {
      return std::tie(level, cell, place) < std::tie(other.level, other.cell, other.place);
    }
  };

  const LasFile& las_;
  const FileBytes& file_;
  const CopcQuery& query_;
  bool lenient_;
  const LazLayout& layout_;
  Info info_;
  std::int32_t deepest_ = kDeepest;
  std::vector<Page> pages_;
  std::set<std::uint64_t> seen_pages_;
  std::uint64_t bytes_read_ = 0;  // of pages
  std::vector<Key> keys_;
  std::vector<bool> named_, wanted_;  // of each chunk: has an entry; is asked for
  std::string first_damage_;          // with its place
};

std::vector<LazChunk> NodeSearch::find(std::vector<std::string>* notes) {
  read_info();
  if (query_.resolution > 0.0 && info_.spacing > 0.0) {
    const double levels = std::ceil(std::log2(info_.spacing / query_.resolution));
    deepest_ = static_cast<std::int32_t>(std::clamp(levels, 0.0, double{kDeepest}));
  }
  pages_.push_back(info_.root);
  while (!pages_.empty()) {
    const Page page = pages_.back();
    pages_.pop_back();
    read_page(page);
  }
  judge_unnamed(notes);
  std::vector<LazChunk> out;
  for (std::size_t i = 0; i < layout_.chunks.size(); ++i) {
    if (wanted_[i]) out.push_back(layout_.chunks[i]);
  }
  return out;
}

void NodeSearch::read_info() {
  const LasRecord& record = *find_info(las_);
  const std::string bytes = file_.read(record.content, kInfoSize);
  for (std::size_t axis = 0; axis < 3; ++axis) info_.centre[axis] = load<double>(bytes, 8 * axis);
  info_.half_size = load<double>(bytes, 24);
  info_.spacing = load<double>(bytes, 32);
  info_.root = {load<std::uint64_t>(bytes, 40), load<std::uint64_t>(bytes, 48)};
  const bool finite = std::isfinite(info_.centre[0]) && std::isfinite(info_.centre[1]) &&
                      std::isfinite(info_.half_size) && std::isfinite(info_.spacing);
  if (!finite || info_.half_size < 0.0 || info_.spacing < 0.0) {
    file_.fail_at(record.content,
                  "found a COPC cube or spacing that is negative or not finite, expected lengths");
  }
}

/// Leniently what is damaged is passed over.
void NodeSearch::damage(std::uint64_t place, const std::string& reason) {
  if (!lenient_) file_.fail_at(place, reason);
  if (first_damage_.empty()) first_damage_ = "byte " + std::to_string(place) + ": " + reason;
}

void NodeSearch::read_page(const Page& page) {
  if (!seen_pages_.insert(page.start).second) {
    return damage(page.start,
                  "found a page of the COPC index for the second time, expected each once");
  }
  const std::uint64_t start = std::min(page.start, file_.size());
  const std::uint64_t there = std::min(page.size, file_.size() - start);
  if (there != page.size || page.size % kEntrySize != 0) {
    damage(start, "found a page of the COPC index of " + std::to_string(page.size) +
                      " bytes at byte " + std::to_string(page.start) +
                      ", expected a multiple of 32 within the file");
  }
  if (bytes_read_ > file_.size()) {
    return damage(start, "found pages of the COPC index that overlap, expected each entry once");
  }
  bytes_read_ += there;
  const std::string bytes = file_.read(start, there - there % kEntrySize);
  for (std::size_t at = 0; at < bytes.size(); at += kEntrySize) {
    read_entry(bytes, at, start + at);
  }
}

void NodeSearch::read_entry(const std::string& bytes, std::size_t at, std::uint64_t place) {
  const auto level = load<std::int32_t>(bytes, at);
  Cell cell{};
  bool in_cube = level >= 0 && level <= kDeepest;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    cell[axis] = load<std::int32_t>(bytes, at + 4 + 4 * axis);
    in_cube = in_cube && cell[axis] >= 0 && cell[axis] >> level == 0;
  }
  const auto start = load<std::uint64_t>(bytes, at + 16);
  const auto size = load<std::int32_t>(bytes, at + 24);
  const auto points = load<std::int32_t>(bytes, at + 28);
  if (!in_cube || size < 0 || points < -1) {
    return damage(place, "found an entry of the COPC index at level " + std::to_string(level) +
                             " with " + std::to_string(size) + " bytes and " +
                             std::to_string(points) + " points, expected a node or a page");
  }
  if (points == -1) {
    pages_.push_back({start, static_cast<std::uint64_t>(size)});
    return;
  }
  keys_.push_back({level, cell, place});
  if (points == 0) return;
  LazChunk chunk;
  chunk.start = start;
  chunk.size = static_cast<std::uint64_t>(size);
  chunk.points = static_cast<std::uint64_t>(points);
  take_node(chunk, wanted(level, cell), place);
}

void NodeSearch::take_node(const LazChunk& chunk, bool wanted, std::uint64_t place) {
  const auto known =
      std::lower_bound(layout_.chunks.begin(), layout_.chunks.end(), chunk,
                       [](const LazChunk& a, const LazChunk& b) { return a.start < b.start; });
  if (known == layout_.chunks.end() || known->start != chunk.start || known->size != chunk.size ||
      known->points != chunk.points) {
    return damage(place, "found a node of the COPC index with " + std::to_string(chunk.points) +
                             " points in " + std::to_string(chunk.size) + " bytes at byte " +
                             std::to_string(chunk.start) +
                             ", expected a chunk of the table of chunks");
  }
  const auto number = static_cast<std::size_t>(known - layout_.chunks.begin());
  if (named_[number]) {
    return damage(place, "found a second node of the COPC index at byte " +
                             std::to_string(chunk.start) + ", expected one a chunk");
  }
  named_[number] = true;
  wanted_[number] = wanted;
}

/// The place of the first entry of a node that has one before.
std::optional<std::uint64_t> NodeSearch::first_repeated_node() {
  std::sort(keys_.begin(), keys_.end());
  std::optional<std::uint64_t> first;
  for (std::size_t i = 1; i < keys_.size(); ++i) {
    if (!keys_[i].same_node(keys_[i - 1])) continue;
    first = first ? std::min(*first, keys_[i].place) : keys_[i].place;
  }
  return first;
}

/// Chunks without an entry. Where nothing is asked for but bounds they can be read all the same;
/// their levels are not known.
void NodeSearch::judge_unnamed(std::vector<std::string>* notes) {
  std::uint64_t chunks = 0, points = 0, first = 0, all_points = 0;
  const bool levels = query_.resolution > 0.0;
  for (std::size_t i = 0; i < named_.size(); ++i) {
    all_points += layout_.chunks[i].points;
    if (named_[i]) continue;
    if (chunks == 0) first = layout_.chunks[i].start;
    ++chunks;
    points += layout_.chunks[i].points;
    wanted_[i] = !levels;
  }
  const std::string count = std::to_string(chunks) + " of " + std::to_string(named_.size()) +
                            " chunks, with " + std::to_string(points) + " of " +
                            std::to_string(all_points) + " points,";
  if (chunks > 0) {
    const std::optional<std::uint64_t> repeated = first_repeated_node();
    damage(repeated.value_or(first),
           (repeated ? "found a second entry of a node, and " : "found ") + count +
               " without an entry in the COPC index, expected each to have one");
  }
  if (first_damage_.empty()) return;
  const std::string where = "the COPC index is damaged (" + first_damage_ + ")";
  if (levels && chunks == named_.size() && chunks > 0) {
    throw InputError(file_.name(), where + ": it names no chunk, so that levels are not known");
  }
  if (chunks == 0) {
    notes->push_back(where + ": it names all chunks all the same");
  } else {
    notes->push_back(where + ": " + count +
                     (levels ? " that it does not name are left out"
                             : " that it does not name are read as if within the bounds"));
  }
}

/// Whether a node, or the nodes below it, can have points that are asked for.
bool NodeSearch::wanted(std::int32_t level, const Cell& cell) const {
  if (level > deepest_) return false;
  if (!query_.bounds) return true;
  // Writers round: points lie up to so much outside of their node.
  constexpr double kMargin = 1e-4;
  const double size = 2.0 * info_.half_size / std::ldexp(1.0, level);
  const std::array<double, 2> low_bounds = {query_.bounds->x0, query_.bounds->y0};
  const std::array<double, 2> high_bounds = {query_.bounds->x1, query_.bounds->y1};
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double margin = kMargin * info_.half_size + 2.0 * std::abs(las_.scale[axis]);
    const double low = info_.centre[axis] - info_.half_size + size * cell[axis];
    if (low - margin >= high_bounds[axis] || low + size + margin < low_bounds[axis]) {
      return false;
    }
  }
  return true;
}

}  // namespace

bool is_copc(const LasFile& las) {
  return las.laz && las.laz->compressor == Compressor::kLayers && find_info(las) != nullptr;
}

void select_nodes(LasFile* las, const CopcQuery& query, bool lenient,
                  std::vector<std::string>* notes) {
  LazLayout layout = *las->laz;
  layout.chunks = NodeSearch(*las, query, lenient).find(notes);
  las->points = 0;
  for (const LazChunk& chunk : layout.chunks) las->points += chunk.points;
  las->laz = std::make_shared<const LazLayout>(std::move(layout));
}

}  // namespace camber::laz
