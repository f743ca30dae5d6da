#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <unordered_map>

#include "camber/cloud/point_stream.h"
#include "camber/core/interruption.h"

namespace camber {

/// A point as a site's raster takes it.
struct SitePoint {
  Eigen::Vector3d place;   ///< the file's units
  int kind = -1;           ///< ASPRS class; -1: none is stated
  int label = -1;          ///< attribute "ground": 1 ground, 0 not; -1: none is stated
  std::size_t number = 0;  ///< in the stream
};

/// ASPRS classes 2, ground, and 11, road surface.
inline bool is_ground_class(int kind) { return kind == 2 || kind == 11; }
/// Noise (7, 18) and what a survey has withdrawn. @param flags  class_flags of LAS
inline bool is_left_out(int kind, int flags) {
  return kind == 7 || kind == 18 || (flags > 0 && (flags & 4) != 0);
}

/// The fields of a stream by which a site's points are known; -1: none.
struct SiteColumns {
  std::array<int, 3> position{};
  int kind = -1, flags = -1, label = -1;

  explicit SiteColumns(const PointStreamHeader& header)
      : position(find_roles(header.fields).position) {
    for (std::size_t i = 0; i < header.fields.size(); ++i) {
      const std::string& name = header.fields[i].name;
      if (name == "classification") kind = static_cast<int>(i);
      if (name == "class_flags") flags = static_cast<int>(i);
      if (name == "ground") label = static_cast<int>(i);
    }
  }
  /// A point of a batch; none where it is left out, not finite or more than 1e9 units from zero.
  bool take(const PointStreamHeader& header, const PointBatch& batch, std::size_t i,
            SitePoint* out) const {
    const auto number = [&](int field) {
      const auto f = static_cast<std::size_t>(field);
      return batch.fields[f].number(header.fields[f].type, i);
    };
    const auto whole = [&](int field) { return field < 0 ? -1 : static_cast<int>(number(field)); };
    out->place = {number(position[0]), number(position[1]), number(position[2])};
    if (!out->place.allFinite() || out->place.cwiseAbs().maxCoeff() > 1e9) return false;
    out->kind = whole(kind);
    out->label = whole(label);
    return !is_left_out(out->kind, whole(flags));
  }
};

/// Calls visit(SitePoint) for the points of a stream that count, in their order. An interruption is
/// looked for. @return how many points the stream has. @throws InputError
template <typename Visit>
std::size_t for_each_site_point(PointSource& source, const Visit& visit) {
  const SiteColumns columns(source.header());
  SitePoint point;
  std::size_t first = 0;
  for (PointBatch batch; source.next(batch); first += batch.count) {
    throw_if_interrupted();
    for (std::size_t i = 0; i < batch.count; ++i) {
      if (!columns.take(source.header(), batch, i, &point)) continue;
      point.number = first + i;
      visit(point);
    }
  }
  return first;
}

/// How far apart the points of the ground lie, by their number in squares of 4 m.
class SiteSpacing {
 public:
  /// @param metres  of a unit of x and y
  explicit SiteSpacing(double metres);
  void add(const Eigen::Vector3d& place);  ///< of the ground, in the file's units
  /// By the median of the squares that have points, in the file's units; 0 where there are none.
  double spacing() const;

 private:
  double side_;
  std::unordered_map<std::uint64_t, std::uint32_t> squares_;
};

/// Cells where none are asked for: a length that people use (the greatest of 1, 2, 5 and their
/// tenfolds that is no more than 0.75 of it).
double site_cell(double ground_spacing);
/// How far from a cell's centre the ground may be, see SiteRasterOptions; all in one unit.
/// @param fill_holes  width of holes that are to be filled
double site_reach(double cell, double ground_spacing, double fill_holes);

}  // namespace camber
