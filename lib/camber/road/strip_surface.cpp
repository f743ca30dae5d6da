#include "camber/road/strip_surface.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

#include "camber/road/plan_polygon.h"

namespace camber {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

/// Heights z = a x + b y + c about a middle, strip frame.
struct HeightFit {
  Vector3d abc = Vector3d::Zero();
  Matrix3d covariance = Matrix3d::Zero();  // of all cells as one observation
  double rms = 0.0;                        // m, of the weighted residuals
  bool found = false;
};

/// Iterated with the weights of Student's distribution of four degrees of freedom, as the strip's
/// cells were fused.
HeightFit fit_heights(const std::vector<const StripCell*>& cells, const Vector3d& middle) {
  constexpr int kIterations = 8;
  constexpr double kFreedom = 4.0;
  HeightFit out;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Matrix3d information = Matrix3d::Zero();
    Vector3d gradient = Vector3d::Zero();
    double weights = 0.0, squares = 0.0;
    for (const StripCell* cell : cells) {
      const Vector3d row(cell->point.x() - middle.x(), cell->point.y() - middle.y(), 1.0);
      const double z = cell->point.z() - middle.z(), variance = cell->sigma * cell->sigma;
      const double off = z - row.dot(out.abc);
      const double scatter = variance + out.rms * out.rms;
      const double weight = iteration == 0
                                ? 1.0 / variance
                                : (kFreedom + 1.0) / (kFreedom + off * off / scatter) / variance;
      information += weight * row * row.transpose();
      gradient += weight * z * row;
      weights += weight;
      squares += weight * off * off;
    }
    const Eigen::LDLT<Matrix3d> solver(information);
    if (solver.info() != Eigen::Success || !(solver.rcond() > 1e-9)) return out;
    out.abc = solver.solve(gradient);
    out.rms = iteration == 0 ? 0.0 : std::sqrt(squares / weights);
    out.covariance = static_cast<double>(cells.size()) * solver.solve(Matrix3d::Identity());
  }
  out.found = out.abc.allFinite() && out.covariance.allFinite();
  return out;
}

/// The covariance of (a, b, c) as that of (tilt about axis1, tilt about axis2, height along the
/// normal).
Matrix3d plane_covariance(const HeightFit& fit, const UncertainPlane& plane) {
  const double up = plane.plane.normal.z();
  // Heights over two more places and the middle determine all three parameters.
  Matrix3d heights, jacobian;
  const Vector3d offsets[3] = {Vector3d::Zero(), plane.axis1, plane.axis2};
  for (int i = 0; i < 3; ++i) {
    heights.row(i) << offsets[i].x(), offsets[i].y(), 1.0;
    jacobian.row(i) = plane.height_jacobian(plane.centroid + offsets[i]) / up;
  }
  const Matrix3d turned = jacobian.inverse() * heights;
  return turned * fit.covariance * turned.transpose();
}

/// The outline of cells in plan, on the plane.
std::vector<Vector3d> outline_of(const std::vector<const StripCell*>& cells, const DrivenLine& line,
                                 double half, const HeightFit& fit, const Vector3d& middle) {
  std::vector<Vector2d> corners;
  for (const StripCell* cell : cells) {
    Vector2d ahead;
    line.at(cell->s, &ahead);
    const Vector2d left(-ahead.y(), ahead.x());
    for (const double along : {-half, half}) {
      for (const double across : {-half, half}) {
        corners.emplace_back(cell->point.head<2>() - middle.head<2>() + along * ahead +
                             across * left);
      }
    }
  }
  std::vector<Vector3d> out;
  for (const Vector2d& c : convex_hull(std::move(corners))) {
    out.push_back(middle + Vector3d(c.x(), c.y(), fit.abc.dot(Vector3d(c.x(), c.y(), 1.0))));
  }
  return out;
}

PatchKind kind_of(const std::vector<const StripCell*>& cells) {
  std::size_t road = 0, pavement = 0;
  for (const StripCell* cell : cells) {
    road += cell->label == 1 ? 1 : 0;
    pavement += cell->label == 2 ? 1 : 0;
  }
  if (2 * road >= cells.size()) return PatchKind::kRoad;
  return 2 * pavement >= cells.size() ? PatchKind::kPavement : PatchKind::kGround;
}

/// Half the pitch of the cells: the least distance of two in s.
double half_cell(const RoadStrip& strip) {
  double pitch = 1e30;
  for (std::size_t i = 1; i < strip.cells.size(); ++i) {
    const double step = std::abs(strip.cells[i].s - strip.cells[i - 1].s);
    if (step > 1e-6) pitch = std::min(pitch, step);
  }
  return pitch < 1e30 ? 0.5 * pitch : 0.0;
}

bool make_patch(const std::vector<const StripCell*>& cells, const DrivenLine& line, double half,
                PlanePatch* patch) {
  Vector3d middle = Vector3d::Zero();
  double s = 0.0;
  for (const StripCell* cell : cells) {
    middle += cell->point / static_cast<double>(cells.size());
    s += cell->s / static_cast<double>(cells.size());
  }
  const HeightFit fit = fit_heights(cells, middle);
  if (!fit.found) return false;
  UncertainPlane& plane = patch->plane;
  const Vector3d normal = Vector3d(-fit.abc.x(), -fit.abc.y(), 1.0).normalized();
  plane.centroid = middle + Vector3d(0.0, 0.0, fit.abc.z());
  plane.plane = Plane::through(plane.centroid, normal);
  Vector2d ahead;
  line.at(s, &ahead);
  UncertainPlane::make_axes(normal, {ahead.x(), ahead.y(), 0.0}, &plane.axis1, &plane.axis2);
  plane.covariance = plane_covariance(fit, plane);
  patch->kind = kind_of(cells);
  patch->status = Status::kOk;
  patch->inliers = static_cast<int>(cells.size());
  patch->noise = patch->unmodelled_sigma = fit.rms;
  patch->boundary = outline_of(cells, line, half, fit, middle);
  patch->grade = std::asin(std::clamp(plane.axis1.z(), -1.0, 1.0));
  patch->bank = std::asin(std::clamp(plane.axis2.z(), -1.0, 1.0));
  return patch->boundary.size() >= 3;
}

}  // namespace

void StripSurfaceOptions::validate() const {
  for (const auto& [name, value] : {std::pair("length", length), {"width", width}}) {
    if (!(value > 0.0)) {
      throw std::invalid_argument(
          fmt::format("surface of a strip: {} = {}, expected > 0", name, value));
    }
  }
  if (fewest_cells < 3) {
    throw std::invalid_argument(
        fmt::format("surface of a strip: fewest_cells = {}, expected at least 3", fewest_cells));
  }
}

RoadSurface strip_surface(const RoadStrip& strip, const StripSurfaceOptions& options,
                          StripPatches* where) {
  options.validate();
  RoadSurface out;
  out.frame = "z-up";
  out.up = Vector3d::UnitZ();
  for (const DrivenPoint& p : strip.line.points()) out.driven_line.push_back(p.foot);
  std::map<std::pair<int, int>, std::vector<const StripCell*>> bins;
  for (const StripCell& cell : strip.cells) {
    bins[{static_cast<int>(std::floor(cell.s / options.length)),
          static_cast<int>(std::floor(cell.lateral / options.width + 0.5))}]
        .push_back(&cell);
  }
  if (where) *where = {std::vector<int>(strip.cells.size(), -1), {}};
  const double half = half_cell(strip);
  for (const auto& [index, cells] : bins) {
    if (cells.size() < static_cast<std::size_t>(options.fewest_cells)) continue;
    PlanePatch patch;
    patch.id = static_cast<int>(out.patches.size());
    if (!make_patch(cells, strip.line, half, &patch)) continue;
    if (where) {
      double s = 0.0;
      for (const StripCell* cell : cells) {
        where->of_cell[static_cast<std::size_t>(cell - strip.cells.data())] = patch.id;
        s += cell->s / static_cast<double>(cells.size());
      }
      where->stations.push_back(s);
    }
    out.patches.push_back(std::move(patch));
  }
  return out;
}

}  // namespace camber
