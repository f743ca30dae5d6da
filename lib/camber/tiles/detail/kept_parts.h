#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

/// Points that were decoded for one tile and that the next one needs, too.
namespace camber::detail {

/// A point of a part, in steps of TilePoints from the part's origin.
struct KeptPoint {
  std::int32_t x = 0, y = 0, z = 0;
  std::uint8_t kind = 0, flags = 0;
};

/// All points of a part of a tile's file, in their order.
struct KeptPart {
  std::array<std::int64_t, 3> origin{};  ///< steps from zero
  std::vector<KeptPoint> points;
};

/// What tiles that are worked on one after the other hand on: each leaves the parts that reach into
/// the next one or its halo, nothing else, so that along a row of tiles only the margins to its
/// sides are decoded more than once.
class KeptParts {
 public:
  using Place = std::pair<std::size_t, std::size_t>;  ///< tile, part

  /// Whose reading comes after the one that is next; a number beyond all tiles: none does.
  void set_next(std::size_t tile) { next_ = tile; }
  std::size_t next() const { return next_; }

  /// nullptr where it was not left.
  const KeptPart* find(const Place& place) const {
    const auto found = before_.find(place);
    return found == before_.end() ? nullptr : &found->second;
  }
  void leave(const Place& place, KeptPart part) { now_[place] = std::move(part); }
  /// The same of one that was left already. @param place  find() has it; no longer, after this
  void leave_again(const Place& place) {
    auto node = before_.extract(place);
    now_.insert(std::move(node));
  }
  /// A tile has been read.
  void turn() {
    before_ = std::move(now_);
    now_.clear();
  }

 private:
  std::size_t next_ = SIZE_MAX;
  std::map<Place, KeptPart> before_, now_;
};

}  // namespace camber::detail
