#include "camber/pipeline/marking_statements.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "camber/pipeline/iterated_update.h"

namespace camber {
namespace {

constexpr double kPainting = 0.02;  // m, by which the ends of paint are off their places
constexpr double kGate = 3.0;       // standard deviations
constexpr double kNearRows = 12.0;  // a stroke seen in so many rows has a length of its own
constexpr int kMostHidden = 2;      // strokes of a line in a row that may be hidden

/// A pixel on the ground with the spread of its row and column.
struct Mark {
  Eigen::Vector2d pixel;
  double sigma_u = 0.0, sigma_v = 0.0;
};

/// Two marks that lie `length` apart, m; `sine` of the angle between their line and the direction
/// in which the length counts.
struct KnownLength {
  std::size_t from, to;
  double length;
  double sine = 1.0;
};

class Solver {
 public:
  Solver(const GroundField& field, const PinholeCamera& camera, double metres_per_unit,
         std::vector<Mark> marks, const Eigen::MatrixXd& shared_covariance, double inflation,
         double scale_sigma)
      : camera_(camera), metres_per_unit_(metres_per_unit), marks_(std::move(marks)) {
    const auto n = static_cast<Eigen::Index>(marks_.size());
    start_.resize(n);
    slope_.resize(n, 2);
    std::vector<Eigen::Vector2d> pixels;
    for (Eigen::Index i = 0; i < n; ++i) {
      const Eigen::Vector2d& p = marks_[static_cast<std::size_t>(i)].pixel;
      pixels.push_back(p);
      start_[i] = field.inverse_depth(p);
      const Eigen::Vector2d du(4, 0), dv(0, 2);
      slope_(i, 0) = (field.inverse_depth(p + du) - field.inverse_depth(p - du)) / 8.0;
      slope_(i, 1) = (field.inverse_depth(p + dv) - field.inverse_depth(p - dv)) / 4.0;
    }
    prior_ = field.metric_covariance(pixels, shared_covariance, inflation, scale_sigma);
  }

  Eigen::Index size() const { return start_.size(); }
  const Eigen::VectorXd& start() const { return start_; }
  const Eigen::MatrixXd& prior() const { return prior_; }

  Eigen::Vector3d point(const Eigen::VectorXd& x, std::size_t i) const {
    return metres_per_unit_ / x[static_cast<Eigen::Index>(i)] * camera_.ray(marks_[i].pixel);
  }

  double length(const Eigen::VectorXd& x, const KnownLength& k) const {
    return k.sine * (point(x, k.to) - point(x, k.from)).norm();
  }

  /// d(length) / d(inverse depths), and by what the marks' pixels and the paint spread it.
  void linearise(const Eigen::VectorXd& x, const KnownLength& k, Eigen::RowVectorXd* by_field,
                 Eigen::RowVectorXd* by_pixel) const {
    *by_field = Eigen::RowVectorXd::Zero(size());
    *by_pixel = Eigen::RowVectorXd::Zero(3 * size());
    const Eigen::Vector3d a = point(x, k.from), b = point(x, k.to);
    const Eigen::Vector3d along = k.sine * (b - a).normalized();
    for (const auto& [i, sign] : {std::pair{k.from, -1.0}, std::pair{k.to, 1.0}}) {
      const auto e = static_cast<Eigen::Index>(i);
      const Eigen::Vector3d p = point(x, i);
      (*by_field)[e] = -sign * along.dot(p) / x[e];
      // A mark elsewhere in the image lies elsewhere on the same ground.
      const double z = p.z();
      const Eigen::Vector3d du(z / camera_.fx, 0, 0), dv(0, z / camera_.fy, 0);
      (*by_pixel)[3 * e] = sign * marks_[i].sigma_u * along.dot(du - p * (slope_(e, 0) / x[e]));
      (*by_pixel)[3 * e + 1] = sign * marks_[i].sigma_v * along.dot(dv - p * (slope_(e, 1) / x[e]));
      (*by_pixel)[3 * e + 2] = sign * kPainting;
    }
  }

  using Stack = internal::StatementStack;
  Stack stack(const Eigen::VectorXd& x, const std::vector<KnownLength>& lengths) const {
    Stack out;
    const auto n = static_cast<Eigen::Index>(lengths.size());
    out.by_field.resize(n, size());
    out.missing.resize(n);
    Eigen::MatrixXd by_pixel(n, 3 * size());
    for (Eigen::Index k = 0; k < n; ++k) {
      const KnownLength& known = lengths[static_cast<std::size_t>(k)];
      Eigen::RowVectorXd field, pixel;
      linearise(x, known, &field, &pixel);
      out.by_field.row(k) = field;
      by_pixel.row(k) = pixel;
      out.missing[k] = known.length - length(x, known);
    }
    out.noise = by_pixel * by_pixel.transpose();
    return out;
  }

  /// Iterated Kalman update of the marks' inverse depths.
  void solve(const std::vector<KnownLength>& lengths, Eigen::VectorXd* x,
             Eigen::MatrixXd* covariance) const {
    internal::iterated_update(
        start_, prior_, [&](const Eigen::VectorXd& at) { return stack(at, lengths); }, x,
        covariance);
  }

 private:
  const PinholeCamera& camera_;
  double metres_per_unit_;
  std::vector<Mark> marks_;
  Eigen::VectorXd start_;
  Eigen::Matrix<double, Eigen::Dynamic, 2> slope_;  // d(inverse depth) / d(pixel)
  Eigen::MatrixXd prior_;
};

/// The middle of a stroke along the ground: beyond half way of its pixels, since far parts shrink.
Eigen::Vector2d metric_middle(const GroundField& field, const PaintedDash& dash) {
  const double near = field.inverse_depth(dash.near_end), far = field.inverse_depth(dash.far_end);
  if (!(near > far) || !(far > 0)) return dash.centroid;
  const double middle = 2.0 * near * far / (near + far);
  const double share = (middle - near) / (far - near);
  const Eigen::Vector2d at = dash.near_end + share * (dash.far_end - dash.near_end);
  return at + (dash.centroid - 0.5 * (dash.near_end + dash.far_end));
}

}  // namespace

MarkingStatements marking_statements(const GroundField& field, const PinholeCamera& camera,
                                     const LaneMarkings& markings, const LaneMarkingSizes& sizes,
                                     double metres_per_unit, double scale_sigma,
                                     const Eigen::MatrixXd& shared_covariance, double inflation) {
  MarkingStatements out;
  std::vector<Mark> marks;
  std::vector<KnownLength> certain;  // those of one marking
  const std::size_t dashes = markings.dashes.size();
  for (const PaintedDash& dash : markings.dashes) {
    marks.push_back({metric_middle(field, dash), 0.2, dash.sigma});
  }
  struct Owner {
    std::size_t dash;
    bool crossing;
  };
  std::vector<Owner> owners;
  for (std::size_t i = 0; i < dashes; ++i) {
    const PaintedDash& dash = markings.dashes[i];
    if (dash.rows < kNearRows) continue;
    certain.push_back({marks.size(), marks.size() + 1, sizes.dash_length});
    owners.push_back({i, false});
    marks.push_back({dash.near_end, 0.2, 0.3});
    marks.push_back({dash.far_end, 0.2, 0.3});
  }
  for (std::size_t i = 0; i < markings.crossings.size(); ++i) {
    const PaintedCrossing& c = markings.crossings[i];
    const auto at = [&](const Eigen::Vector2d& p) -> Eigen::Vector3d {
      return camera.ray(p) / field.inverse_depth(p);
    };
    const Eigen::Vector3d across = (at(c.last) - at(c.first)).normalized();
    const Eigen::Vector3d along = (at(c.along) - at(c.first)).normalized();
    const double sine = across.cross(along).norm();
    if (!(sine > 0.7)) continue;
    certain.push_back({marks.size(), marks.size() + 1,
                       (c.stripes - 1) * (sizes.stripe_width + sizes.stripe_gap), sine});
    owners.push_back({i, true});
    marks.push_back({c.first, c.sigma, 0.0});
    marks.push_back({c.last, c.sigma, 0.0});
  }
  for (const Mark& mark : marks) {
    if (!(field.inverse_depth(mark.pixel) > metres_per_unit / 150.0)) {
      out.reason = "a marking lies where there is no ground";
      return out;
    }
  }
  if (marks.empty()) {
    out.reason = "no marking of the sizes given is seen whole";
    return out;
  }
  const Solver solver(field, camera, metres_per_unit, marks, shared_covariance, inflation,
                      scale_sigma);
  Eigen::VectorXd x = solver.start();
  Eigen::MatrixXd covariance = solver.prior();
  std::vector<KnownLength> accepted;
  std::vector<char> used(dashes, 0);
  int refused = 0;
  // Standard deviations by which a length is missed, given what is accepted.
  const auto gate = [&](const KnownLength& k) {
    const Solver::Stack s = solver.stack(x, {k});
    const double variance = (s.by_field * covariance * s.by_field.transpose() + s.noise)(0, 0);
    return s.missing[0] / std::sqrt(variance);
  };
  const auto accept = [&](std::size_t k) {
    if (std::abs(gate(certain[k])) > kGate) {
      ++refused;
      return;
    }
    accepted.push_back(certain[k]);
    solver.solve(accepted, &x, &covariance);
    if (owners[k].crossing) ++out.crossings;
  };
  for (std::size_t k = 0; k < certain.size(); ++k) {
    if (owners[k].crossing) accept(k);
  }
  // Broken lines: from each stroke to the next one along it.
  const double period = sizes.dash_length + sizes.dash_gap;
  std::vector<char> joined(dashes, 0);
  for (std::size_t first = 0; first < dashes; ++first) {
    if (joined[first]) continue;
    const PaintedDash& start = markings.dashes[first];
    if (start.rows < 4) continue;  // a line begins with a stroke whose direction is seen
    Eigen::Vector3d heading = camera.ray(start.far_end) / field.inverse_depth(start.far_end) -
                              camera.ray(start.near_end) / field.inverse_depth(start.near_end);
    const Eigen::VectorXd x_before = x;
    const Eigen::MatrixXd covariance_before = covariance;
    const std::size_t accepted_before = accepted.size();
    std::vector<std::size_t> line = {first};
    while (true) {
      const std::size_t here = line.back();
      std::size_t best = dashes;
      KnownLength known{0, 0, 0.0};
      double least = 1e9;
      for (std::size_t next = 0; next < dashes; ++next) {
        if (next == here || joined[next]) continue;
        const Eigen::Vector3d step = solver.point(x, next) - solver.point(x, here);
        if (!(step.dot(heading) > 0)) continue;
        // A bend, and half a line's width of error in the direction of a stroke.
        if (std::atan2(step.cross(heading).norm(), step.dot(heading)) > 0.12) continue;
        // Which stroke of the line it is must be beyond doubt.
        std::optional<KnownLength> fitting;
        int possible = 0;
        for (int periods = 1; periods <= kMostHidden + 2; ++periods) {
          const KnownLength k{here, next, periods * period};
          if (std::abs(gate(k)) > kGate) continue;
          ++possible;
          if (periods <= kMostHidden + 1) fitting = k;
        }
        if (possible != 1 || !fitting) continue;
        if (step.norm() < least) {
          least = step.norm();
          best = next;
          known = *fitting;
        }
      }
      if (best == dashes) break;
      accepted.push_back(known);
      solver.solve(accepted, &x, &covariance);
      heading = solver.point(x, best) - solver.point(x, here);
      line.push_back(best);
    }
    // Two short bars at the right distance are chance.
    const bool sure = line.size() >= 3 || (line.size() == 2 && markings.dashes[line[1]].rows >= 4);
    if (!sure) {
      accepted.resize(accepted_before);
      x = x_before;
      covariance = covariance_before;
      continue;
    }
    for (const std::size_t i : line) used[i] = joined[i] = 1;
  }
  // Strokes of a line tell by their lengths too; a bright bar alone may be a kerb.
  for (std::size_t k = 0; k < certain.size(); ++k) {
    if (!owners[k].crossing && used[owners[k].dash]) accept(k);
  }
  if (accepted.empty()) {
    out.reason = refused > 0 ? "the markings seen contradict the ground by more than three "
                               "standard deviations"
                             : "no two strokes of a line are seen whole";
    return out;
  }
  if (refused >= static_cast<int>(accepted.size())) {
    out.reason = "most markings contradict the ground: are their sizes right?";
    return out;
  }
  out.dashes = static_cast<int>(std::count(used.begin(), used.end(), 1));
  for (const KnownLength& k : accepted) {
    for (const std::size_t i : {k.from, k.to}) {
      out.farthest = std::max(out.farthest, solver.point(x, i).norm());
    }
  }
  out.scale_change = -scale_sigma * scale_sigma *
                     solver.start().dot(solver.prior().ldlt().solve(x - solver.start()));
  // Statements at the solution, relative to the field as it is.
  const Solver::Stack before = solver.stack(solver.start(), accepted);
  const Solver::Stack s = solver.stack(x, accepted);
  const auto mean_square = [&](const Solver::Stack& at, const Eigen::MatrixXd& prior) {
    const Eigen::MatrixXd all = at.by_field * prior * at.by_field.transpose() + at.noise;
    return at.missing.dot(all.ldlt().solve(at.missing)) / static_cast<double>(accepted.size());
  };
  out.misfit_before = mean_square(before, solver.prior());
  out.misfit_after =
      s.missing.dot(s.noise.ldlt().solve(s.missing)) / static_cast<double>(accepted.size());
  for (std::size_t i = 0; i < marks.size(); ++i) out.statements.pixels.push_back(marks[i].pixel);
  out.statements.coefficients = s.by_field;
  out.statements.values = s.missing + s.by_field * (x - solver.start());
  out.statements.noise = s.noise;
  return out;
}

}  // namespace camber
