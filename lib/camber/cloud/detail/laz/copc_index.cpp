#include "camber/cloud/detail/laz/copc_index.h"

#include "camber/cloud/detail/las_format.h"

namespace camber::laz {
namespace {

constexpr std::size_t kEntryLength = 32, kInfoLength = 160;

/// Parts the nodes among pages: where there are many, a page has some levels, and the nodes below
/// these have pages of their own unless they are few.
class Pages {
 public:
  explicit Pages(const std::vector<CopcNode>& nodes) : nodes_(nodes) { add_page(0, nodes.size()); }

  CopcIndex write(std::uint64_t place) const {
    std::vector<std::uint64_t> starts;
    std::uint64_t at = place;
    for (const std::vector<Entry>& page : pages_) {
      starts.push_back(at);
      at += kEntryLength * page.size();
    }
    CopcIndex out;
    out.root_size = kEntryLength * pages_.front().size();
    for (const std::vector<Entry>& page : pages_) {
      for (const Entry& entry : page) {
        const CopcNode& node = nodes_[entry.node];
        if (entry.page == 0) {
          append(&out.pages, node.key, node.chunk.start, node.chunk.size,
                 static_cast<std::int32_t>(node.chunk.points));
        } else {
          append(&out.pages, node.key, starts[entry.page], kEntryLength * pages_[entry.page].size(),
                 -1);
        }
      }
    }
    return out;
  }

 private:
  struct Entry {
    std::size_t node = 0;
    std::size_t page = 0;  // 0: the node itself, else the page that has it and what is below
  };

  std::size_t add_page(std::size_t begin, std::size_t end) {
    constexpr std::int32_t kLevels = 4;
    constexpr std::size_t kFew = 64;
    const std::size_t page = pages_.size();
    pages_.emplace_back();
    const bool parted = end - begin > kMostEntriesOfPage;
    for (std::size_t i = begin; i < end;) {
      const bool may_part = parted && nodes_[i].key.level == nodes_[begin].key.level + kLevels;
      const std::size_t next = may_part ? subtree_end(i, end) : i;
      if (next - i > kFew) {
        const std::size_t below = add_page(i, next);
        pages_[page].push_back({i, below});
        i = next;
      } else {
        pages_[page].push_back({i, 0});
        ++i;
      }
    }
    return page;
  }

  /// Where the nodes below one end.
  std::size_t subtree_end(std::size_t node, std::size_t end) const {
    std::size_t next = node + 1;
    while (next < end && nodes_[next].key.level > nodes_[node].key.level) ++next;
    return next;
  }

  static void append(std::string* out, const OctreeKey& key, std::uint64_t start,
                     std::uint64_t size, std::int32_t points) {
    const std::size_t at = out->size();
    out->resize(at + kEntryLength);
    detail::store(*out, at, key.level);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      detail::store(*out, at + 4 + 4 * axis, key.cell[axis]);
    }
    detail::store(*out, at + 16, start);
    detail::store(*out, at + 24, static_cast<std::int32_t>(size));
    detail::store(*out, at + 28, points);
  }

  const std::vector<CopcNode>& nodes_;
  std::vector<std::vector<Entry>> pages_;
};

}  // namespace

CopcIndex make_copc_index(const std::vector<CopcNode>& nodes, std::uint64_t place) {
  if (!nodes.empty()) return Pages(nodes).write(place);
  CopcIndex out;  // of no points: an empty root
  out.pages.assign(kEntryLength, '\0');
  out.root_size = kEntryLength;
  return out;
}

std::string copc_info(const CopcInfo& info) {
  std::string out(kInfoLength, '\0');
  const double half = 0.5 * info.cube.side;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    detail::store(out, 8 * axis, info.cube.low[axis] + half);
  }
  detail::store(out, 24, half);
  detail::store(out, 32, info.cube.side / kOctreeCells);
  detail::store(out, 40, info.root_start);
  detail::store(out, 48, info.root_size);
  detail::store(out, 56, info.first_time);
  detail::store(out, 64, info.last_time);
  return out;
}

}  // namespace camber::laz
