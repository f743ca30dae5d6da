#include "camber/road/consistency_graph.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>

#include "camber/road/cost_functions/height_continuity.h"
#include "camber/road/cost_functions/plane_consistency.h"
#include "camber/road/cost_functions/plane_prior.h"
#include "camber/road/plan_polygon.h"

namespace camber {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr double kStepGate = 3.0;                // standard deviations of a height step
constexpr double kCauchy = 2.0;                  // standard deviations, scale of the loss of a link
constexpr double kStacked = 1.0;                 // m, a patch above another
constexpr double kStackedShare = 0.2;            // of the smaller one's area that overlaps
constexpr double kBorderError = 0.3;             // m, how well the boundaries of patches are known
constexpr double kUnseenCurvature = 1.0 / 60.0;  // 1/m, that ground may have where none is seen
// A patch may be off the ground by so many standard deviations of a point, and at most so far, m.
constexpr double kHiddenBend = 0.8, kMostHidden = 0.1;

/// A surface seen in plan.
struct PlanView {
  Vector3d up;
  GroundAxes axes;
  std::vector<PlanPolygon> polygons;

  explicit PlanView(const RoadSurface& surface)
      : up(surface.up.normalized()), axes(surface.up.normalized()) {
    for (const PlanePatch& patch : surface.patches) {
      PlanPolygon polygon;
      for (const Vector3d& corner : patch.boundary) polygon.push_back(axes(corner));
      polygons.push_back(std::move(polygon));
    }
  }

  /// The place on a plane above or below a place in plan.
  Vector3d on_plane(const Plane& plane, const Vector2d& place) const {
    const Vector3d flat = place.x() * axes.e1 + place.y() * axes.e2;
    return flat - plane.signed_distance(flat) / plane.normal.dot(up) * up;
  }
  double height(const Plane& plane, const Vector2d& place) const {
    return on_plane(plane, place).dot(up);
  }
  /// d(height along up at a place) / d(plane parameters).
  Eigen::RowVector3d jacobian(const UncertainPlane& plane, const Vector2d& place) const {
    return plane.height_jacobian(on_plane(plane.plane, place)) / plane.plane.normal.dot(up);
  }
};

void require(bool good, const char* field, double value, const char* bound) {
  if (!good) {
    throw std::invalid_argument(
        fmt::format("ConsistencyOptions::{} is {}, expected {}", field, value, bound));
  }
}

/// Whether two patches' planes meet in a crease between their middles.
bool crosses_between(const PlanView& view, const PlanePatch& a, const PlanePatch& b) {
  const Vector2d ca = view.axes(a.plane.centroid), cb = view.axes(b.plane.centroid);
  const double at_a = view.height(a.plane.plane, ca) - view.height(b.plane.plane, ca);
  const double at_b = view.height(a.plane.plane, cb) - view.height(b.plane.plane, cb);
  return at_a * at_b < 0.0;
}

/// Pairs of patches whose boxes in plan are no farther apart than that, in order. Boxes stand in
/// the strips that they cover, in each by their left sides, so that only near ones are compared.
std::vector<std::pair<std::size_t, std::size_t>> near_pairs(const PlanView& view, double distance) {
  const std::size_t count = view.polygons.size();
  std::vector<Eigen::AlignedBox2d> boxes(count);
  double height = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    for (const Vector2d& corner : view.polygons[i]) boxes[i].extend(corner);
    if (!boxes[i].isEmpty()) height += boxes[i].sizes().y() / static_cast<double>(count);
  }
  const double strip = distance + height;
  const auto strip_of = [&](double y) { return static_cast<std::int64_t>(std::floor(y / strip)); };
  std::map<std::int64_t, std::vector<std::size_t>> strips;
  for (std::size_t i = 0; i < count; ++i) {
    if (boxes[i].isEmpty()) continue;
    const std::int64_t last = strip_of(boxes[i].max().y() + distance);
    for (std::int64_t k = strip_of(boxes[i].min().y()); k <= last; ++k) strips[k].push_back(i);
  }
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (auto& [unused, list] : strips) {
    std::sort(list.begin(), list.end(), [&](std::size_t l, std::size_t r) {
      return std::make_pair(boxes[l].min().x(), l) < std::make_pair(boxes[r].min().x(), r);
    });
    for (std::size_t a = 0; a < list.size(); ++a) {
      const Eigen::AlignedBox2d& box = boxes[list[a]];
      for (std::size_t b = a + 1; b < list.size(); ++b) {
        const Eigen::AlignedBox2d& other = boxes[list[b]];
        if (other.min().x() > box.max().x() + distance) break;
        if (box.exteriorDistance(other) > distance) continue;
        pairs.emplace_back(std::min(list[a], list[b]), std::max(list[a], list[b]));
      }
    }
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

Vector2d middle_of(const PolygonGap& gap) { return 0.5 * (gap.on_a + gap.on_b); }

/// Sets the step and the angle of a link from the planes as they are.
void measure(const PlanView& view, const PlanePatch& a, const PlanePatch& b, const Vector2d& middle,
             PatchLink* link) {
  link->angle = angle_between(a.plane.plane.normal, b.plane.plane.normal);
  link->height_step = view.height(b.plane.plane, middle) - view.height(a.plane.plane, middle);
}

/// Sets all of a link but its ids.
void judge(const PlanView& view, const RoadSurface& surface, const ConsistencyOptions& options,
           std::size_t ia, std::size_t ib, const PolygonGap& gap, PatchLink* link) {
  const PlanePatch &a = surface.patches[ia], &b = surface.patches[ib];
  const Vector2d middle = middle_of(gap);
  link->distance = gap.distance;
  measure(view, a, b, middle, link);
  const double share = gap.distance / options.link_distance;
  link->weight = std::exp(-2.0 * share * share);
  const Eigen::RowVector3d ja = view.jacobian(a.plane, middle), jb = view.jacobian(b.plane, middle);
  const double sigma = std::sqrt((ja * a.plane.covariance * ja.transpose())(0) +
                                 (jb * b.plane.covariance * jb.transpose())(0));
  link->valid = true;
  link->reason.clear();
  const double smaller = std::min(polygon_area(view.polygons[ia]), polygon_area(view.polygons[ib]));
  if (gap.overlap_area > kStackedShare * smaller && std::abs(link->height_step) > kStacked) {
    link->valid = false;
    link->reason = fmt::format("one lies {:.2f} m above the other", std::abs(link->height_step));
  } else if (link->angle > options.max_angle) {
    link->valid = false;
    link->reason = fmt::format("the normals differ by {:.1f} deg", link->angle / kDegree);
  } else {
    // The ground may bend on its way across a gap; a crease between the middles is no step,
    // wherever exactly the boundaries end. Within a patch it bends as far as its points' noise
    // hides.
    const double bend =
        std::tan(link->angle) *
            (0.5 * gap.distance + (crosses_between(view, a, b) ? kBorderError : 0.0)) +
        0.5 * kUnseenCurvature * gap.distance * gap.distance +
        std::min(kHiddenBend * a.noise, kMostHidden) + std::min(kHiddenBend * b.noise, kMostHidden);
    if (std::abs(link->height_step) > options.max_step + kStepGate * sigma + bend) {
      link->valid = false;
      link->reason = fmt::format("a step of {:.2f} m", link->height_step);
    }
  }
}

/// Places along the border of two patches where their heights are to agree: the middle of the gap,
/// and to both sides of it as far as both patches reach.
std::vector<Vector2d> border_places(const PlanView& view, const PlanePatch& a, const PlanePatch& b,
                                    const PlanPolygon& pa, const PlanPolygon& pb,
                                    const Vector2d& middle) {
  const Vector2d across = view.axes(b.plane.centroid) - view.axes(a.plane.centroid);
  if (!(across.norm() > 0.0)) return {middle};
  const Vector2d along = Vector2d(-across.y(), across.x()).normalized();
  double low = -std::numeric_limits<double>::infinity(),
         high = std::numeric_limits<double>::infinity();
  for (const PlanPolygon* polygon : {&pa, &pb}) {
    double from = std::numeric_limits<double>::infinity(), to = -from;
    for (const Vector2d& corner : *polygon) {
      const double s = along.dot(corner - middle);
      from = std::min(from, s);
      to = std::max(to, s);
    }
    low = std::max(low, from);
    high = std::min(high, to);
  }
  if (!(high > low)) return {middle};
  return {middle + (low + 0.2 * (high - low)) * along,
          middle + (high - 0.2 * (high - low)) * along};
}

/// Entries of the inverse of L D L' at the places of L and its diagonal, from the last column to
/// the first: each column needs no others than those of later ones (Takahashi, Fagan and Chen,
/// "Formation of a sparse bus impedance matrix", PICA 1973; Erisman and Tinney, CACM 18, 1975).
class SelectedInverse {
 public:
  /// @param lower  L without its diagonal of ones, rows ascending, with all places of its fill
  SelectedInverse(const Eigen::SparseMatrix<double>& lower, const Eigen::VectorXd& diagonal)
      : entries_(lower), diagonal_(lower.cols()) {
    Eigen::VectorXd factors = Eigen::VectorXd::Zero(lower.cols()), sums = factors;
    for (Eigen::Index j = lower.cols() - 1; j >= 0; --j) {
      for (Entry entry(lower, j); entry; ++entry) {
        factors[entry.row()] = entry.value();
        sums[entry.row()] = 0.0;
      }
      // Rows of this column that meet in a later column are a place of L there.
      for (Entry entry(lower, j); entry; ++entry) {
        const Eigen::Index k = entry.row();
        const double factor = entry.value();
        double sum = factor * diagonal_[k];
        for (Entry known(entries_, k); known; ++known) {
          sum += factors[known.row()] * known.value();
          sums[known.row()] += factor * known.value();
        }
        sums[k] += sum;
      }
      double sum = 1.0 / diagonal[j];
      for (Entry entry(entries_, j); entry; ++entry) {
        entry.valueRef() = -sums[entry.row()];
        sum += sums[entry.row()] * factors[entry.row()];
        factors[entry.row()] = 0.0;
      }
      diagonal_[j] = sum;
    }
  }

  /// @param row,column  a place of L or of its transpose, or the diagonal
  double operator()(Eigen::Index row, Eigen::Index column) const {
    return row == column ? diagonal_[row]
                         : entries_.coeff(std::max(row, column), std::min(row, column));
  }

 private:
  using Entry = Eigen::SparseMatrix<double>::InnerIterator;
  Eigen::SparseMatrix<double> entries_;  // below the diagonal
  Eigen::VectorXd diagonal_;
};

/// The 3 x 3 blocks on the diagonal of the inverse of J' J.
std::vector<Matrix3d> inverse_blocks(const ceres::CRSMatrix& jacobian) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int row = 0; row < jacobian.num_rows; ++row) {
    const auto begin = static_cast<std::size_t>(jacobian.rows[static_cast<std::size_t>(row)]),
               end = static_cast<std::size_t>(jacobian.rows[static_cast<std::size_t>(row) + 1]);
    for (std::size_t i = begin; i < end; ++i) {
      for (std::size_t j = begin; j < end; ++j) {
        entries.emplace_back(jacobian.cols[i], jacobian.cols[j],
                             jacobian.values[i] * jacobian.values[j]);
      }
    }
  }
  Eigen::SparseMatrix<double> information(jacobian.num_cols, jacobian.num_cols);
  information.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(information);
  std::vector<Matrix3d> blocks(static_cast<std::size_t>(jacobian.num_cols / 3),
                               Matrix3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  if (solver.info() != Eigen::Success) return blocks;
  const SelectedInverse inverse(solver.matrixL().nestedExpression(), solver.vectorD());
  const auto& places = solver.permutationP().indices();
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    for (Eigen::Index row = 0; row < 3; ++row) {
      for (Eigen::Index column = 0; column < 3; ++column) {
        const auto first = static_cast<Eigen::Index>(3 * k);
        blocks[k](row, column) = inverse(places[first + row], places[first + column]);
      }
    }
  }
  return blocks;
}

/// The least-squares problem of the patches that valid links join: three parameters a patch (tilt,
/// tilt, height), its own covariance as the prior.
struct GraphProblem {
  ceres::Problem problem;
  std::vector<Vector3d> change;  ///< a patch
  std::vector<int> block_of;     ///< a patch; -1: not in the problem
  std::vector<double*> blocks;
};

/// Links between patches of one kind that both have an answer.
std::vector<const PatchLink*> usable_links(const RoadSurface& surface,
                                           const std::map<int, std::size_t>& index) {
  const auto usable = [](const PlanePatch& patch) {
    return patch.status == Status::kOk || patch.status == Status::kWeak;
  };
  std::vector<const PatchLink*> used;
  for (const PatchLink& link : surface.links) {
    if (!link.valid) continue;
    const PlanePatch& a = surface.patches[index.at(link.a)];
    const PlanePatch& b = surface.patches[index.at(link.b)];
    if (a.kind != b.kind || a.kind == PatchKind::kOther || !usable(a) || !usable(b)) continue;
    used.push_back(&link);
  }
  return used;
}

void add_priors(const RoadSurface& surface, const std::vector<char>& linked, GraphProblem& graph) {
  const std::size_t count = surface.patches.size();
  graph.change.assign(count, Vector3d::Zero());
  graph.block_of.assign(count, -1);
  for (std::size_t i = 0; i < count; ++i) {
    if (!linked[i]) continue;
    const Matrix3d information = surface.patches[i].plane.covariance.inverse();
    const Eigen::LLT<Matrix3d> llt(0.5 * (information + information.transpose()));
    if (llt.info() != Eigen::Success) continue;
    graph.block_of[i] = static_cast<int>(graph.blocks.size());
    graph.blocks.push_back(graph.change[i].data());
    graph.problem.AddResidualBlock(PlanePrior::create(llt.matrixU()), nullptr,
                                   graph.change[i].data());
  }
}

/// A link's terms between the patches at places ia and ib. @param middle  of the gap between them
void add_link(const PlanView& view, const RoadSurface& surface, const ConsistencyOptions& options,
              const PatchLink& link, std::size_t ia, std::size_t ib, const Vector2d& middle,
              GraphProblem& graph) {
  const PlanePatch &a = surface.patches[ia], &b = surface.patches[ib];
  double* change_a = graph.change[ia].data();
  double* change_b = graph.change[ib].data();
  const double slack = std::sqrt(std::max(link.weight, 1e-3));
  if (options.consistency == Consistency::kPaper) {
    const Vector3d origin = view.on_plane(a.plane.plane, middle);
    graph.problem.AddResidualBlock(
        PlaneConsistency::create(a.plane, b.plane, origin, options.normal_sigma * (1.0 / slack),
                                 options.offset_sigma * (1.0 / slack)),
        new ceres::CauchyLoss(kCauchy), change_a, change_b);
    return;
  }
  for (const Vector2d& place :
       border_places(view, a, b, view.polygons[ia], view.polygons[ib], middle)) {
    // The ground may bend on its way across a gap, and where it bends is not known to the inch.
    const double bend = std::tan(link.angle) * (0.5 * link.distance + kBorderError);
    const double sigma = std::hypot(options.continuity_sigma, bend) / slack;
    graph.problem.AddResidualBlock(
        HeightContinuity::create(
            view.height(b.plane.plane, place) - view.height(a.plane.plane, place),
            view.jacobian(a.plane, place), view.jacobian(b.plane, place), sigma),
        new ceres::CauchyLoss(kCauchy), change_a, change_b);
  }
}

/// Solves to the end: where it stops early depends on rounding.
/// @return whether the solution is usable.
bool solve_graph(GraphProblem& graph, ConsistencyReport& report) {
  ceres::Solver::Options solver;
  solver.linear_solver_type =
      graph.blocks.size() > 60 ? ceres::SPARSE_NORMAL_CHOLESKY : ceres::DENSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = 50;
  solver.function_tolerance = 1e-12;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &graph.problem, &summary);
  report.initial_cost = summary.initial_cost;
  report.final_cost = summary.final_cost;
  report.residuals = summary.num_residuals_reduced;
  report.converged = summary.termination_type == ceres::CONVERGENCE;
  return summary.IsSolutionUsable();
}

/// Moves the planes and their outlines; covariances are the inverse of the Gauss-Newton matrix at
/// the solution.
void apply_solution(const PlanView& view, GraphProblem& graph, RoadSurface* surface) {
  ceres::Problem::EvaluateOptions evaluate;
  evaluate.parameter_blocks = graph.blocks;
  ceres::CRSMatrix jacobian;
  graph.problem.Evaluate(evaluate, nullptr, nullptr, nullptr, &jacobian);
  const std::vector<Matrix3d> covariances = inverse_blocks(jacobian);
  for (std::size_t i = 0; i < surface->patches.size(); ++i) {
    if (graph.block_of[i] < 0) continue;
    PlanePatch& patch = surface->patches[i];
    UncertainPlane& plane = patch.plane;
    plane.plane = plane.perturbed(graph.change[i]);
    plane.centroid = plane.plane.foot(plane.centroid);
    const Vector3d along = plane.axis1;
    UncertainPlane::make_axes(plane.plane.normal, along, &plane.axis1, &plane.axis2);
    const Matrix3d& block = covariances[static_cast<std::size_t>(graph.block_of[i])];
    if (block.allFinite()) plane.covariance = 0.5 * (block + block.transpose());
    for (std::size_t k = 0; k < patch.boundary.size(); ++k) {
      patch.boundary[k] = view.on_plane(plane.plane, view.polygons[i][k]);
    }
  }
}

}  // namespace

void ConsistencyOptions::validate() const {
  require(link_distance > 0.0, "link_distance", link_distance, "> 0 m");
  require(max_angle > 0.0 && max_angle < M_PI / 2, "max_angle", max_angle, "(0, pi / 2) rad");
  require(max_step > 0.0, "max_step", max_step, "> 0 m");
  require(continuity_sigma > 0.0, "continuity_sigma", continuity_sigma, "> 0 m");
  require(normal_sigma > 0.0, "normal_sigma", normal_sigma, "> 0 rad");
  require(offset_sigma > 0.0, "offset_sigma", offset_sigma, "> 0 m");
}

std::vector<PatchLink> find_links(const RoadSurface& surface, const ConsistencyOptions& options) {
  options.validate();
  const PlanView view(surface);
  std::vector<PatchLink> links;
  for (const auto& [i, j] : near_pairs(view, options.link_distance)) {
    const PolygonGap gap = polygon_gap(view.polygons[i], view.polygons[j]);
    if (!(gap.distance <= options.link_distance)) continue;
    PatchLink link;
    link.a = surface.patches[i].id;
    link.b = surface.patches[j].id;
    judge(view, surface, options, i, j, gap, &link);
    links.push_back(std::move(link));
  }
  return links;
}

ConsistencyReport optimise_surface(const ConsistencyOptions& options, RoadSurface* surface) {
  options.validate();
  ConsistencyReport report;
  report.converged = true;
  const std::size_t count = surface->patches.size();
  const PlanView view(*surface);
  std::map<int, std::size_t> index;
  for (std::size_t i = 0; i < count; ++i) index[surface->patches[i].id] = i;
  const std::vector<const PatchLink*> used = usable_links(*surface, index);
  if (options.consistency == Consistency::kNone || used.empty()) return report;
  std::vector<char> linked(count, 0);
  for (const PatchLink* link : used) linked[index.at(link->a)] = linked[index.at(link->b)] = 1;
  // Outlines stay where they are in plan.
  std::vector<Vector2d> middles;
  for (const PatchLink& link : surface->links) {
    middles.push_back(
        middle_of(polygon_gap(view.polygons[index.at(link.a)], view.polygons[index.at(link.b)])));
  }
  GraphProblem graph;
  add_priors(*surface, linked, graph);
  for (const PatchLink* link : used) {
    const std::size_t ia = index.at(link->a), ib = index.at(link->b);
    if (graph.block_of[ia] < 0 || graph.block_of[ib] < 0) continue;
    const auto at = static_cast<std::size_t>(link - surface->links.data());
    add_link(view, *surface, options, *link, ia, ib, middles[at], graph);
  }
  if (graph.blocks.empty() || !solve_graph(graph, report)) return report;
  apply_solution(view, graph, surface);
  for (std::size_t k = 0; k < surface->links.size(); ++k) {
    PatchLink& link = surface->links[k];
    measure(view, surface->patches[index.at(link.a)], surface->patches[index.at(link.b)],
            middles[k], &link);
  }
  align_patches_with_road(surface);
  return report;
}

void align_patches_with_road(RoadSurface* surface) {
  const Vector3d up = surface->up.normalized();
  const GroundAxes axes(up);
  std::map<int, std::size_t> index;
  for (std::size_t i = 0; i < surface->patches.size(); ++i) index[surface->patches[i].id] = i;
  // Overall direction: from the first to the last of the driven line; else away from a camera; else
  // the long axis of the road.
  Vector2d ahead = Vector2d::Zero();
  if (surface->driven_line.size() >= 2) {
    ahead = axes(surface->driven_line.back() - surface->driven_line.front());
  } else if (surface->frame == "camera") {
    ahead = axes(Vector3d::UnitZ());
  }
  if (ahead.norm() < 1e-9) {
    Vector2d mean = Vector2d::Zero();
    std::vector<Vector2d> places;
    for (const PlanePatch& patch : surface->patches) {
      if (patch.kind != PatchKind::kRoad && patch.kind != PatchKind::kGround) continue;
      for (const Vector3d& corner : patch.boundary) {
        places.push_back(axes(corner));
        mean += places.back();
      }
    }
    if (!places.empty()) {
      mean /= static_cast<double>(places.size());
      Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
      for (const Vector2d& p : places) scatter += (p - mean) * (p - mean).transpose();
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(scatter);
      ahead = solver.eigenvectors().col(1);
      // Its sign is free: along the larger component.
      int largest = 0;
      ahead.cwiseAbs().maxCoeff(&largest);
      if (ahead[largest] < 0.0) ahead = -ahead;
    } else {
      ahead = Vector2d::UnitX();
    }
  }
  std::vector<std::vector<const PatchLink*>> links(surface->patches.size());
  for (const PatchLink& link : surface->links) {
    if (!link.valid) continue;
    links[index.at(link.a)].push_back(&link);
    links[index.at(link.b)].push_back(&link);
  }
  for (std::size_t i = 0; i < surface->patches.size(); ++i) {
    PlanePatch& patch = surface->patches[i];
    UncertainPlane& plane = patch.plane;
    const Vector2d here = axes(plane.centroid);
    Vector2d direction = Vector2d::Zero();
    // The driven line's direction at its nearest part.
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k + 1 < surface->driven_line.size(); ++k) {
      const Vector2d from = axes(surface->driven_line[k]), to = axes(surface->driven_line[k + 1]);
      const double distance = (0.5 * (from + to) - here).norm();
      if (distance < nearest && (to - from).norm() > 1e-6) {
        nearest = distance;
        direction = to - from;
      }
    }
    if (direction.norm() < 1e-9 && patch.kind != PatchKind::kOther) {
      for (const PatchLink* link : links[i]) {
        const PlanePatch& other =
            surface->patches[index.at(link->a == patch.id ? link->b : link->a)];
        if (other.kind != patch.kind) continue;
        Vector2d way = axes(other.plane.centroid) - here;
        if (way.dot(ahead) < 0.0) way = -way;
        direction += way;
      }
    }
    Vector3d along = direction.x() * axes.e1 + direction.y() * axes.e2;
    if (direction.norm() < 1e-9) {
      along = plane.axis1;
      if (axes(along).dot(ahead) < 0.0) along = -along;
    }
    // New axes and the covariance in them: the tilt is the vector t1 axis1 + t2 axis2.
    const Vector3d old1 = plane.axis1, old2 = plane.axis2;
    // The in-plane direction that lies over `along` in plan.
    const double slant = plane.plane.normal.dot(up);
    if (std::abs(slant) > 1e-6) {
      along -= plane.plane.normal.dot(along) / slant * up;
    }
    UncertainPlane::make_axes(plane.plane.normal, along, &plane.axis1, &plane.axis2);
    Matrix3d turn = Matrix3d::Identity();
    turn(0, 0) = plane.axis1.dot(old1);
    turn(0, 1) = plane.axis1.dot(old2);
    turn(1, 0) = plane.axis2.dot(old1);
    turn(1, 1) = plane.axis2.dot(old2);
    plane.covariance = turn * plane.covariance * turn.transpose();
    patch.grade = std::asin(std::clamp(plane.axis1.dot(up), -1.0, 1.0));
    // Cross slope: of the level direction across the road, left side up.
    patch.bank = std::asin(std::clamp(plane.axis2.dot(up), -1.0, 1.0));
  }
}

}  // namespace camber
