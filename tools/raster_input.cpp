#include "raster_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <utility>

#include "camber/core/errors.h"
#include "crs.h"
#include "gdal_functions.h"

namespace camber::tools {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kBlock = 64;           // cells of a side that are read at a time
constexpr double kSpacing = 1.0;     // m between points
constexpr double kMostPoints = 1e8;  // near the places that are asked for
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

}  // namespace

/// Blocks of cells that were read.
struct RasterInput::Cells {
  std::map<std::pair<int, int>, RasterWindow> blocks;  ///< by row and column of the block

  /// The value of a cell; NaN where it is not known or was not read.
  template <typename T>
  T at(int column, int row, const std::vector<T> RasterWindow::*values) const {
    const auto found =
        column < 0 || row < 0 ? blocks.end() : blocks.find({row / kBlock, column / kBlock});
    if (found == blocks.end()) return std::numeric_limits<T>::quiet_NaN();
    const RasterWindow& window = found->second;
    const int x = column - window.column, y = row - window.row;
    if (x >= window.columns || y >= window.rows || (window.*values).empty()) {
      return std::numeric_limits<T>::quiet_NaN();
    }
    return (window.*values)[static_cast<std::size_t>(y) * static_cast<std::size_t>(window.columns) +
                            static_cast<std::size_t>(x)];
  }
  /// Between the middles of cells. @param at  in cells, the middle of the first at 0
  template <typename T>
  T between(const Vector2d& place, const std::vector<T> RasterWindow::*values) const {
    const int column = static_cast<int>(std::floor(place.x()));
    const int row = static_cast<int>(std::floor(place.y()));
    const double u = place.x() - column, v = place.y() - row;
    double sum = 0.0;
    for (int k = 0; k < 4; ++k) {
      const double weight = (k % 2 == 0 ? 1.0 - u : u) * (k < 2 ? 1.0 - v : v);
      if (weight > 0.0) sum += weight * double{at(column + k % 2, row + k / 2, values)};
    }
    return static_cast<T>(sum);
  }
};

bool is_raster(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::array<char, 4> first{};
  if (!in.read(first.data(), first.size())) return false;
  return std::memcmp(first.data(), "II*\0", 4) == 0 || std::memcmp(first.data(), "MM\0*", 4) == 0 ||
         std::memcmp(first.data(), "II+\0", 4) == 0 || std::memcmp(first.data(), "MM\0+", 4) == 0;
}

RasterInput::RasterInput(const std::string& path, const std::string& crs)
    : path_(path), header_(gdal_functions().read_raster_header(path)) {
  if (!crs.empty()) {
    system_ = crs_from_option(crs);
  } else if (!header_.crs.empty()) {
    system_ = crs_from_definition(header_.crs, path);
  }
  if (system_) complete_crs(&*system_);
  if (system_ && system_->horizontal.angle) {
    throw NoAnswerError(fmt::format(
        "{}: the cells are in longitude and latitude ({}), expected a raster of a map in lengths, "
        "as gdalwarp -t_srs makes it",
        path, describe(*system_)));
  }
  // The band's own unit goes before that of the coordinate system.
  const CoordinateUnit unit = unit_from_name(header_.unit);
  if (unit.angle) {
    throw InputError(path, fmt::format("band {}: found numbers in {}, expected heights",
                                       header_.band, header_.unit));
  }
  if (unit.known() && (system_ || !unit.metre())) {
    if (!system_) system_.emplace();
    system_->vertical = unit;
    system_->vertical_stated = true;
  }
  if (system_) {
    metres_ = system_->horizontal.known() ? system_->horizontal.metres : 1.0;
    height_metres_ = system_->vertical.known() ? system_->vertical.metres : metres_;
  }
  const std::array<double, 6>& t = header_.place;
  sides_ << t[1], t[2], t[4], t[5];
  sides_ *= metres_;
  cell_ = std::max(sides_.col(0).norm(), sides_.col(1).norm());
}

Vector2d RasterInput::place_of(double column, double row) const {
  const Vector2d corner(header_.place[0], header_.place[3]);
  return metres_ * corner + sides_ * Vector2d(column + 0.5, row + 0.5);
}

Vector2d RasterInput::cell_of(const Vector2d& place) const {
  const Vector2d corner(header_.place[0], header_.place[3]);
  return sides_.inverse() * (place - metres_ * corner) - Vector2d(0.5, 0.5);
}

Eigen::AlignedBox2d RasterInput::extent() const {
  Eigen::AlignedBox2d out;
  for (const double column : {-0.5, header_.columns - 0.5}) {
    for (const double row : {-0.5, header_.rows - 0.5}) out.extend(place_of(column, row));
  }
  return out;
}

bool RasterInput::interpolated() const { return cell_ > kSpacing * (1.0 + 1e-9); }

/// The blocks with the cells near the places, and those beside them.
RasterInput::Cells RasterInput::load(const PlanCorridor& where) const {
  const Eigen::Matrix2d inverse = sides_.inverse();
  const Vector2d beside(where.reach * inverse.row(0).norm() + 2.0,
                        where.reach * inverse.row(1).norm() + 2.0);
  std::set<std::pair<int, int>> wanted;
  const Vector2d last(header_.columns - 1, header_.rows - 1);
  for (const Vector2d& place : where.places) {
    const Vector2d middle = cell_of(place);
    const Vector2d low = (middle - beside).cwiseMax(0.0), high = (middle + beside).cwiseMin(last);
    if (!(low.x() <= high.x() && low.y() <= high.y())) continue;
    for (int row = static_cast<int>(low.y()) / kBlock; row <= static_cast<int>(high.y()) / kBlock;
         ++row) {
      for (int column = static_cast<int>(low.x()) / kBlock;
           column <= static_cast<int>(high.x()) / kBlock; ++column) {
        wanted.emplace(row, column);
      }
    }
  }
  const double cells = static_cast<double>(wanted.size()) * kBlock * kBlock;
  if (cells > kMostPoints) {
    throw NoAnswerError(
        fmt::format("{}: {:.0f} cells lie near the line, expected at most {:.0f}: "
                    "take a part of it",
                    path_, cells, kMostPoints));
  }
  std::vector<RasterWindow> windows;
  for (const auto& [row, column] : wanted) {
    RasterWindow window;
    window.column = column * kBlock;
    window.row = row * kBlock;
    window.columns = std::min(kBlock, header_.columns - window.column);
    window.rows = std::min(kBlock, header_.rows - window.row);
    windows.push_back(std::move(window));
  }
  if (!windows.empty()) gdal_functions().read_raster(path_, header_, &windows);
  Cells out;
  for (RasterWindow& window : windows) {
    const std::pair key(window.row / kBlock, window.column / kBlock);
    out.blocks.emplace(key, std::move(window));
  }
  return out;
}

void RasterInput::add_cells(const Cells& cells, RoadCloud* out) const {
  for (const auto& [key, window] : cells.blocks) {
    for (int i = 0; i < window.rows * window.columns; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (!std::isfinite(window.values[k])) continue;
      const Vector2d place =
          place_of(window.column + i % window.columns, window.row + i / window.columns);
      const Vector3d point(place.x(), place.y(), height_metres_ * window.values[k]);
      if (out->points.empty()) out->origin = point.array().round();
      out->points.push_back((point - out->origin).cast<float>());
      if (header_.sigma_band != 0) {
        out->sigmas.push_back(static_cast<float>(height_metres_) * window.sigmas[k]);
      }
    }
  }
}

/// Points on one lattice, whatever the places are.
void RasterInput::add_between(const Cells& cells, const PlanCorridor& where, RoadCloud* out) const {
  std::set<std::pair<std::int64_t, std::int64_t>> squares;
  const auto steps = static_cast<std::int64_t>(std::ceil(where.reach / kSpacing));
  const double side = static_cast<double>(steps) * kSpacing;
  for (const Vector2d& place : where.places) {
    const Vector2d square = (place / side).array().floor();
    if (!(square.cwiseAbs().maxCoeff() < 1e15)) continue;
    const auto x = static_cast<std::int64_t>(square.x()), y = static_cast<std::int64_t>(square.y());
    for (int k = 0; k < 9; ++k) squares.emplace(y + k / 3 - 1, x + k % 3 - 1);
  }
  if (static_cast<double>(squares.size()) * static_cast<double>(steps * steps) > kMostPoints) {
    throw NoAnswerError(path_ + ": the line is too long: take a part of it");
  }
  for (const auto& [row, column] : squares) {
    for (std::int64_t i = 0; i < steps * steps; ++i) {
      const Vector2d place((static_cast<double>(column * steps + i % steps) + 0.5) * kSpacing,
                           (static_cast<double>(row * steps + i / steps) + 0.5) * kSpacing);
      const Vector2d at = cell_of(place);
      if (!(at.minCoeff() > -1.0 && at.x() < header_.columns && at.y() < header_.rows)) continue;
      const double height = height_metres_ * cells.between(at, &RasterWindow::values);
      if (!std::isfinite(height)) continue;
      const Vector3d point(place.x(), place.y(), height);
      if (out->points.empty()) out->origin = point.array().round();
      out->points.push_back((point - out->origin).cast<float>());
      if (header_.sigma_band != 0) {
        out->sigmas.push_back(static_cast<float>(height_metres_) *
                              cells.between(at, &RasterWindow::sigmas));
      }
    }
  }
}

RoadCloud RasterInput::read(const PlanCorridor& where) const {
  RoadCloud out;
  out.frame = CloudFrame::kZUp;
  const Cells cells = load(where);
  if (interpolated()) {
    add_between(cells, where, &out);
  } else {
    add_cells(cells, &out);
  }
  for (float& sigma : out.sigmas) {
    if (!(sigma >= 0.0f)) sigma = kUnknown;
  }
  return out;
}

std::string remark_on_units(const RasterInput& raster) {
  if (!raster.system()) return {};
  const std::string remark = unit_remark(*raster.system());
  return remark.empty() ? remark : remark + "; they were converted to metres, in which results are";
}

PlanCorridor corridor_along(const std::vector<Vector3d>& line, double reach) {
  constexpr double kMostPlaces = 5e7;
  double length = 0.0;
  for (std::size_t i = 1; i < line.size(); ++i) {
    length += (line[i] - line[i - 1]).head<2>().norm();
  }
  if (!(length / reach < kMostPlaces)) {
    throw NoAnswerError(fmt::format("the line is {:.3g} m long, expected at most {:.3g}", length,
                                    kMostPlaces * reach));
  }
  PlanCorridor out;
  out.reach = reach;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const Vector2d here = line[i].head<2>();
    const Vector2d before = i > 0 ? Vector2d(line[i - 1].head<2>()) : here;
    const int steps = static_cast<int>(std::floor((here - before).norm() / reach));
    for (int k = 1; k <= steps; ++k) {
      out.places.push_back(before + (here - before) * (static_cast<double>(k) / (steps + 1)));
    }
    out.places.push_back(here);
  }
  return out;
}

namespace {

/// Its points' sigmas are an error that neighbours share.
class RasterGround : public HeightSource {
 public:
  RasterGround(const RasterInput& raster, const PlanCorridor& where)
      : cloud_(raster.read(where)),
        interpolated_(raster.interpolated()),
        heights_(cloud_heights(cloud_, PlanFrame(Vector3d::UnitZ()), &where)) {
    if (cloud_.sigmas.empty()) return;
    // As heights, of which there is one at each point.
    RoadCloud sigmas = cloud_;
    for (std::size_t i = 0; i < sigmas.size(); ++i) {
      sigmas.points[i].z() = cloud_.sigmas[i];
      sigmas.origin.z() = 0.0;
    }
    sigmas_ = cloud_heights(sigmas, PlanFrame(Vector3d::UnitZ()), &where);
  }
  GroundSample at(const Vector3d& place) const override {
    GroundSample out = at_only_level(*heights_, place);
    const double shared = sigmas_ ? at_only_level(*sigmas_, place).height : std::nan("");
    if (interpolated_ || std::isfinite(shared)) out.sigma = std::hypot(out.sigma, shared);
    return out;
  }
  std::vector<double> levels(const Vector2d& place) const override {
    return heights_->levels(place);
  }
  double resolution() const override { return heights_->resolution(); }

 private:
  /// A raster has one height at a place, however far it is from what is asked for.
  static GroundSample at_only_level(const HeightSource& heights, const Vector3d& place) {
    const std::vector<double> levels = heights.levels(place.head<2>());
    return levels.empty() ? GroundSample()
                          : heights.at({place.x(), place.y(), levels[levels.size() / 2]});
  }

  RoadCloud cloud_;
  bool interpolated_;
  std::unique_ptr<HeightSource> heights_, sigmas_;
};

}  // namespace

std::unique_ptr<HeightSource> raster_heights(const RasterInput& raster, const PlanCorridor& where) {
  return std::make_unique<RasterGround>(raster, where);
}

}  // namespace camber::tools
