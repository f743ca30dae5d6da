#include "camber/scale/lane_marking_constraint.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "camber/scale/detail/length_measurements.h"
#include "camber/scale/detail/metric_middle.h"

namespace camber {
namespace {

using detail::GroundAtPixels;
using detail::LinearisedLengths;
using detail::UpdatedDepths;

constexpr double kNearRows = 12.0;   // a stroke seen in so many rows has a length of its own
constexpr int kMostHidden = 2;       // strokes of a line in a row that may be hidden
constexpr double kFarthest = 150.0;  // m, of a mark

/// Spread of a mark's place in the image, px.
struct MarkSigma {
  double u = 0.0, v = 0.0;
};

/// Two marks that lie `length` apart, m; `sine` of the angle between their line and the direction
/// in which the length counts.
struct KnownLength {
  Eigen::Index from, to;
  double length;
  double sine = 1.0;
  double sine_sigma = 0.0;
};

/// The lengths of a dash or crossing itself.
struct OwnLength {
  KnownLength length;
  std::size_t dash;  // meaningless for a crossing
  bool crossing;
};

/// Marks on the ground and the known lengths between them.
class KnownLengths {
 public:
  KnownLengths(const RoadPosterior& road, const PinholeCamera& camera,
               std::vector<Eigen::Vector2d> pixels, std::vector<MarkSigma> sigmas,
               const ScaleNoise& noise)
      : camera_(camera),
        ground_(road, camera, std::move(pixels)),
        sigmas_(std::move(sigmas)),
        noise_(noise) {}

  const GroundAtPixels& ground() const { return ground_; }

  Eigen::Vector3d point(const Eigen::VectorXd& x, Eigen::Index i) const {
    return ground_.point(x, i);
  }

  LinearisedLengths linearise(const Eigen::VectorXd& x,
                              const std::vector<KnownLength>& lengths) const {
    const auto n = static_cast<Eigen::Index>(lengths.size());
    LinearisedLengths out;
    out.by_inverse_depth = Eigen::MatrixXd::Zero(n, ground_.size());
    out.residual.resize(n);
    // By the marks' columns and rows and by the paint, by the sizes that all paint shares, and by
    // the stripes' direction, each in standard deviations.
    const Eigen::Index marks = 3 * ground_.size();
    Eigen::MatrixXd by_error = Eigen::MatrixXd::Zero(n, marks + 1 + n);
    for (Eigen::Index k = 0; k < n; ++k) {
      const KnownLength& known = lengths[static_cast<std::size_t>(k)];
      const Eigen::Vector3d between = point(x, known.to) - point(x, known.from);
      out.residual[k] = known.length - known.sine * between.norm();
      by_error(k, marks) = noise_.painted_size * known.length;
      by_error(k, marks + 1 + k) = known.sine_sigma * between.norm();
      const Eigen::Vector3d along = known.sine * between.normalized();
      for (const auto& [i, sign] : {std::pair{known.from, -1.0}, std::pair{known.to, 1.0}}) {
        const Eigen::Vector3d p = point(x, i);
        out.by_inverse_depth(k, i) = -sign * along.dot(p) / x[i];
        // A mark elsewhere in the image lies elsewhere on the same ground.
        const Eigen::Vector3d du(p.z() / camera_.fx, 0, 0), dv(0, p.z() / camera_.fy, 0);
        const MarkSigma& sigma = sigmas_[static_cast<std::size_t>(i)];
        by_error(k, 3 * i) = sign * sigma.u * along.dot(du - p * (ground_.by_pixel(i, 0) / x[i]));
        by_error(k, 3 * i + 1) =
            sign * sigma.v * along.dot(dv - p * (ground_.by_pixel(i, 1) / x[i]));
        by_error(k, 3 * i + 2) = sign * noise_.painted_end;
      }
    }
    out.covariance = by_error * by_error.transpose();
    return out;
  }

  UpdatedDepths update(const std::vector<KnownLength>& lengths) const {
    return detail::updated(ground_,
                           [&](const Eigen::VectorXd& x) { return linearise(x, lengths); });
  }

  /// Standard deviations by which a length is missed, given what is known by now.
  double innovation(const UpdatedDepths& now, const KnownLength& length) const {
    const LinearisedLengths l = linearise(now.mean, {length});
    const double variance =
        (l.by_inverse_depth * now.covariance * l.by_inverse_depth.transpose() + l.covariance)(0, 0);
    return l.residual[0] / std::sqrt(variance);
  }

 private:
  const PinholeCamera& camera_;
  GroundAtPixels ground_;
  std::vector<MarkSigma> sigmas_;
  const ScaleNoise& noise_;
};

/// The middle of a stroke along the ground: beyond half of its pixels, since far parts shrink.
Eigen::Vector2d metric_middle(const RoadPosterior& road, const PaintedDash& dash) {
  const double near = road.inverse_depth(dash.near_end), far = road.inverse_depth(dash.far_end);
  if (!(near > far) || !(far > 0)) return dash.centroid;
  const double share = detail::metric_middle_share(near, far);
  const Eigen::Vector2d at = dash.near_end + share * (dash.far_end - dash.near_end);
  return at + (dash.centroid - 0.5 * (dash.near_end + dash.far_end));
}

/// All marks: the strokes' middles first, in their order, then the ends of near strokes and the
/// outermost stripes of crossings.
struct Marks {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<MarkSigma> sigmas;
  std::vector<OwnLength> own;

  void add(const Eigen::Vector2d& pixel, const MarkSigma& sigma) {
    pixels.push_back(pixel);
    sigmas.push_back(sigma);
  }
};

Marks collect_marks(const RoadPosterior& road, const PinholeCamera& camera,
                    const LaneMarkings& markings, const LaneMarkingSizes& sizes,
                    const ScaleNoise& noise) {
  Marks out;
  for (const PaintedDash& dash : markings.dashes) {
    out.add(metric_middle(road, dash), {noise.mark_column_px, dash.sigma});
  }
  const auto next = [&] { return static_cast<Eigen::Index>(out.pixels.size()); };
  for (std::size_t i = 0; i < markings.dashes.size(); ++i) {
    const PaintedDash& dash = markings.dashes[i];
    if (dash.rows < kNearRows) continue;
    out.own.push_back({{next(), next() + 1, sizes.dash_length}, i, false});
    out.add(dash.near_end, {noise.mark_column_px, noise.mark_end_row_px});
    out.add(dash.far_end, {noise.mark_column_px, noise.mark_end_row_px});
  }
  for (const PaintedCrossing& c : markings.crossings) {
    const auto at = [&](const Eigen::Vector2d& p) -> Eigen::Vector3d {
      return camera.ray(p) / road.inverse_depth(p);
    };
    const Eigen::Vector3d across = (at(c.last) - at(c.first)).normalized();
    const Eigen::Vector3d along = (at(c.along) - at(c.first)).normalized();
    const double sine = across.cross(along).norm();
    if (!(sine > 0.7)) continue;
    const double length = (c.stripes - 1) * (sizes.stripe_width + sizes.stripe_gap);
    const double sine_sigma = std::sqrt(std::max(0.0, 1.0 - sine * sine)) * c.angle_sigma;
    out.own.push_back({{next(), next() + 1, length, sine, sine_sigma}, 0, true});
    out.add(c.first, {c.sigma, 0.0});
    out.add(c.last, {c.sigma, 0.0});
  }
  return out;
}

/// Which known lengths hold between marks: accepted one by one, each against what those before it
/// let expect.
class Association {
 public:
  Association(const KnownLengths& lengths, const LaneMarkings& markings,
              const LaneMarkingSizes& sizes, const ScaleNoise& noise)
      : lengths_(lengths),
        dashes_(markings.dashes),
        period_(sizes.dash_length + sizes.dash_gap),
        gate_(noise.gate),
        now_{lengths.ground().mean, lengths.ground().covariance},
        used_(markings.dashes.size(), 0) {}

  /// @return whether the length was accepted.
  bool accept(const KnownLength& length) {
    if (!(std::abs(lengths_.innovation(now_, length)) <= gate_)) {
      ++rejected_;
      return false;
    }
    accepted_.push_back(length);
    now_ = lengths_.update(accepted_);
    return true;
  }

  /// Broken lines: from each stroke to the next one along it.
  void join_lines(const PinholeCamera& camera, const RoadPosterior& road) {
    for (std::size_t first = 0; first < dashes_.size(); ++first) {
      const PaintedDash& start = dashes_[first];
      // A line begins with a stroke whose direction is seen.
      if (used_[first] || start.rows < 4) continue;
      const Eigen::Vector3d heading =
          camera.ray(start.far_end) / road.inverse_depth(start.far_end) -
          camera.ray(start.near_end) / road.inverse_depth(start.near_end);
      join_line(first, heading);
    }
  }

  bool used(std::size_t dash) const { return used_[dash] != 0; }
  int num_used() const { return static_cast<int>(std::count(used_.begin(), used_.end(), 1)); }
  int rejected() const { return rejected_; }
  const std::vector<KnownLength>& accepted() const { return accepted_; }
  const UpdatedDepths& now() const { return now_; }

 private:
  void join_line(std::size_t first, Eigen::Vector3d heading) {
    const UpdatedDepths before = now_;
    const std::size_t accepted_before = accepted_.size();
    std::vector<std::size_t> line = {first};
    while (const auto next = next_stroke(line.back(), heading)) {
      accepted_.push_back(*next);
      now_ = lengths_.update(accepted_);
      heading = lengths_.point(now_.mean, next->to) - lengths_.point(now_.mean, next->from);
      line.push_back(static_cast<std::size_t>(next->to));
    }
    // Two short bars at the right distance are chance.
    const bool sure = line.size() >= 3 || (line.size() == 2 && dashes_[line[1]].rows >= 4);
    if (!sure) {
      accepted_.resize(accepted_before);
      now_ = before;
      return;
    }
    for (const std::size_t i : line) used_[i] = 1;
  }

  /// The nearest stroke that continues a line, with its distance in whole periods, if unambiguous.
  std::optional<KnownLength> next_stroke(std::size_t here, const Eigen::Vector3d& heading) const {
    std::optional<KnownLength> best;
    double least = 1e9;
    for (std::size_t next = 0; next < dashes_.size(); ++next) {
      if (next == here || used_[next]) continue;
      const auto from = static_cast<Eigen::Index>(here), to = static_cast<Eigen::Index>(next);
      const Eigen::Vector3d step = lengths_.point(now_.mean, to) - lengths_.point(now_.mean, from);
      if (!(step.dot(heading) > 0) || !(step.norm() < least)) continue;
      // A bend, and half a line's width of error in the direction of a stroke.
      if (std::atan2(step.cross(heading).norm(), step.dot(heading)) > 0.12) continue;
      std::optional<KnownLength> fitting;
      int possible = 0;
      for (int periods = 1; periods <= kMostHidden + 2; ++periods) {
        const KnownLength k{from, to, periods * period_};
        if (!(std::abs(lengths_.innovation(now_, k)) <= gate_)) continue;
        ++possible;
        if (periods <= kMostHidden + 1) fitting = k;
      }
      if (possible != 1 || !fitting) continue;
      least = step.norm();
      best = fitting;
    }
    return best;
  }

  const KnownLengths& lengths_;
  const std::vector<PaintedDash>& dashes_;
  double period_, gate_;
  UpdatedDepths now_;
  std::vector<char> used_;  // strokes that belong to a line
  std::vector<KnownLength> accepted_;
  int rejected_ = 0;
};

}  // namespace

LaneMarkingConstraint lane_marking_constraint(const RoadPosterior& road,
                                              const PinholeCamera& camera,
                                              const LaneMarkings& markings,
                                              const LaneMarkingSizes& sizes,
                                              const ScaleNoise& noise) {
  LaneMarkingConstraint out;
  out.constraint.name = "lane_markings";
  const Marks marks = collect_marks(road, camera, markings, sizes, noise);
  if (marks.pixels.empty()) {
    out.reason = "no marking of the sizes given is seen whole";
    return out;
  }
  for (const Eigen::Vector2d& pixel : marks.pixels) {
    if (!(road.inverse_depth(pixel) > 1.0 / kFarthest)) {
      out.reason = "a marking lies where there is no ground";
      return out;
    }
  }
  const KnownLengths lengths(road, camera, marks.pixels, marks.sigmas, noise);
  Association association(lengths, markings, sizes, noise);
  for (const OwnLength& own : marks.own) {
    if (own.crossing && association.accept(own.length)) ++out.crossings;
  }
  association.join_lines(camera, road);
  // Strokes of a line have a length too; a bright bar alone may be a kerb.
  for (const OwnLength& own : marks.own) {
    if (!own.crossing && association.used(own.dash)) association.accept(own.length);
  }
  const std::vector<KnownLength>& accepted = association.accepted();
  if (accepted.empty()) {
    out.contradicts = association.rejected() > 0;
    out.reason = association.rejected() > 0
                     ? "the markings seen contradict the ground by more than three "
                       "standard deviations"
                     : "no two strokes of a line are seen whole";
    return out;
  }
  if (association.rejected() >= static_cast<int>(accepted.size())) {
    out.contradicts = true;
    out.reason = "most markings contradict the ground: are their sizes right?";
    return out;
  }
  const Eigen::VectorXd& solution = association.now().mean;
  out.dashes = association.num_used();
  for (std::size_t i = 0; i < markings.dashes.size(); ++i) {
    if (association.used(i)) out.rows += markings.dashes[i].rows;
  }
  for (const KnownLength& k : accepted) {
    for (const Eigen::Index i : {k.from, k.to}) {
      out.farthest = std::max(out.farthest, lengths.point(solution, i).norm());
    }
  }
  detail::SolvedLengths at_solution = detail::solved(
      lengths.ground(), [&](const Eigen::VectorXd& x) { return lengths.linearise(x, accepted); },
      solution);
  at_solution.constraint.name = out.constraint.name;
  out.constraint = std::move(at_solution.constraint);
  Eigen::VectorXd by_size(out.constraint.size());
  for (Eigen::Index k = 0; k < by_size.size(); ++k) {
    by_size[k] = noise.painted_size * accepted[static_cast<std::size_t>(k)].length;
  }
  out.constraint.common = {{"paint", std::move(by_size)}};
  out.misfit_before = at_solution.misfit_before;
  out.misfit_after = at_solution.misfit_after;
  out.constraint.source =
      fmt::format("{} dashes, {} crossings to {:.0f} m", out.dashes, out.crossings, out.farthest);
  return out;
}

}  // namespace camber
