#include "camber/cloud/detail/laz/copc.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
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

class NodeSearch {
 public:
  NodeSearch(const LasFile& las, const CopcQuery& query)
      : las_(las), file_(*las.bytes), query_(query), layout_(*las.laz) {}

  std::vector<LazChunk> find() {
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
    std::sort(chunks_.begin(), chunks_.end(),
              [](const LazChunk& a, const LazChunk& b) { return a.start < b.start; });
    return std::move(chunks_);
  }

 private:
  void read_info();
  void read_page(const Page& page);
  void read_entry(const std::string& bytes, std::size_t at, std::uint64_t place);
  bool wanted(std::int32_t level, const std::array<std::int32_t, 3>& cell) const;

  const LasFile& las_;
  const FileBytes& file_;
  const CopcQuery& query_;
  const LazLayout& layout_;
  Info info_;
  std::int32_t deepest_ = kDeepest;
  std::vector<Page> pages_;
  std::set<std::uint64_t> seen_pages_, seen_nodes_;
  std::vector<LazChunk> chunks_;
};

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

void NodeSearch::read_page(const Page& page) {
  if (!seen_pages_.insert(page.start).second) {
    file_.fail_at(page.start,
                  "found a page of the COPC index for the second time, expected each once");
  }
  if (page.start > file_.size() || page.size > file_.size() - page.start ||
      page.size % kEntrySize != 0) {
    file_.fail_at(std::min(page.start, file_.size()),
                  "found a page of the COPC index of " + std::to_string(page.size) +
                      " bytes at byte " + std::to_string(page.start) +
                      ", expected a multiple of 32 within the file");
  }
  const std::string bytes = file_.read(page.start, page.size);
  for (std::size_t at = 0; at < bytes.size(); at += kEntrySize) {
    read_entry(bytes, at, page.start + at);
  }
}

void NodeSearch::read_entry(const std::string& bytes, std::size_t at, std::uint64_t place) {
  const auto level = load<std::int32_t>(bytes, at);
  std::array<std::int32_t, 3> cell{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    cell[axis] = load<std::int32_t>(bytes, at + 4 + 4 * axis);
  }
  const auto start = load<std::uint64_t>(bytes, at + 16);
  const auto size = load<std::int32_t>(bytes, at + 24);
  const auto points = load<std::int32_t>(bytes, at + 28);
  if (level < 0 || level > kDeepest || size < 0 || points < -1) {
    file_.fail_at(place, "found an entry of the COPC index at level " + std::to_string(level) +
                             " with " + std::to_string(size) + " bytes and " +
                             std::to_string(points) + " points, expected a node or a page");
  }
  if (points == 0 || !wanted(level, cell)) return;
  if (points == -1) {
    pages_.push_back({start, static_cast<std::uint64_t>(size)});
    return;
  }
  LazChunk chunk;
  chunk.start = start;
  chunk.size = static_cast<std::uint64_t>(size);
  chunk.points = static_cast<std::uint64_t>(points);
  const auto known =
      std::lower_bound(layout_.chunks.begin(), layout_.chunks.end(), chunk,
                       [](const LazChunk& a, const LazChunk& b) { return a.start < b.start; });
  if (known == layout_.chunks.end() || known->start != start || known->size != chunk.size ||
      known->points != chunk.points) {
    file_.fail_at(place, "found a node of the COPC index with " + std::to_string(points) +
                             " points in " + std::to_string(size) + " bytes at byte " +
                             std::to_string(start) + ", expected a chunk of the table of chunks");
  }
  if (!seen_nodes_.insert(start).second) {
    file_.fail_at(place, "found a second node of the COPC index at byte " + std::to_string(start) +
                             ", expected one a chunk");
  }
  chunks_.push_back(chunk);
}

/// Whether a node, or the nodes below it, can have points that are asked for.
bool NodeSearch::wanted(std::int32_t level, const std::array<std::int32_t, 3>& cell) const {
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

void select_nodes(LasFile* las, const CopcQuery& query) {
  LazLayout layout = *las->laz;
  layout.chunks = NodeSearch(*las, query).find();
  las->points = 0;
  for (const LazChunk& chunk : layout.chunks) las->points += chunk.points;
  las->laz = std::make_shared<const LazLayout>(std::move(layout));
}

}  // namespace camber::laz
