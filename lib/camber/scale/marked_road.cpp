#include "camber/scale/marked_road.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/scale/detail/marking_measurements.h"
#include "camber/scale/detail/metric_middle.h"

namespace camber {
namespace {

using detail::MarkingAssociation;
using detail::MarkingMeasurement;
using detail::MarkingMeasurements;
using detail::RoadShape;
using detail::RoadShapeMatrix;
using detail::RoadShapeVector;
using detail::StrokeKind;

// What a measurement that fits counts for a shape, half squared standard deviations: one that is
// farther off counts as not made.
constexpr double kWorthEnd = 4.0, kWorthAcross = 3.0, kWorthWidth = 0.7, kWorthAzimuth = 0.7,
                 kWorthLane = 1.5;
constexpr double kLeastEvidence = 5.0;  // of a shape

double worth(MarkingMeasurement::Kind kind) {
  switch (kind) {
    case MarkingMeasurement::Kind::kEnd:
      return kWorthEnd;
    case MarkingMeasurement::Kind::kAcross:
      return kWorthAcross;
    case MarkingMeasurement::Kind::kWidth:
      return kWorthWidth;
    case MarkingMeasurement::Kind::kAzimuth:
      return kWorthAzimuth;
    case MarkingMeasurement::Kind::kLaneWidth:
      return kWorthLane;
    case MarkingMeasurement::Kind::kSharedWidth:
      break;
  }
  return 0.0;
}

/// A shape with what it makes of the strokes.
struct Hypothesis {
  RoadShapeVector shape = RoadShapeVector::Zero();
  double evidence = 0.0;
  double likelihood = 0.0;  // logarithm: the evidence, with the known height where that chooses
  double misfit = 0.0;
  MarkingAssociation association;
  RoadShapeMatrix covariance = RoadShapeMatrix::Zero();
};

class ShapeSolver {
 public:
  ShapeSolver(const MarkingMeasurements& measurements, const MarkedRoadOptions& options)
      : measurements_(measurements), options_(options) {
    prior_mean_.setZero();
    prior_mean_[detail::kLogHeight] = std::log(options.height);
    prior_sigma_ << options.tilt_along, options.tilt_across, options.log_height, options.curvature,
        options.curvature_change, options.twist, options.cross_curvature;
  }

  const RoadShapeVector& prior_mean() const { return prior_mean_; }

  /// Half squared standard deviations by which the fitting measurements are better than none, less
  /// the prior's.
  double evidence(const MarkingAssociation& association, const Eigen::VectorXd& residuals,
                  const RoadShapeVector& shape) const {
    double out = -0.5 * ((shape - prior_mean_).cwiseQuotient(prior_sigma_)).squaredNorm();
    std::vector<double> dearest(static_cast<std::size_t>(association.groups), 0.0);
    for (std::size_t k = 0; k < association.measurements.size(); ++k) {
      const MarkingMeasurement& m = association.measurements[k];
      const double most = worth(m.kind);
      const double r = residuals[static_cast<Eigen::Index>(k)];
      out += most -
             std::min(0.5 * r * r, m.kind == MarkingMeasurement::Kind::kSharedWidth ? 1e9 : most);
      if (m.group >= 0) {
        double& d = dearest[static_cast<std::size_t>(m.group)];
        d = std::max(d, m.kind == MarkingMeasurement::Kind::kWidth ? 0.0 : most);
      }
    }
    // The free offset of a group takes one of its measurements.
    return out - std::accumulate(dearest.begin(), dearest.end(), 0.0);
  }

  double rough_evidence(const RoadShapeVector& shape, double slack) const {
    const RoadShape road(options_.up, shape);
    MarkingAssociation association = measurements_.associate(road, slack);
    if (association.lines.empty() && association.crossings.empty()) return -1e9;
    const Eigen::VectorXd sigmas = widened(road, association, slack);
    return evidence(association, measurements_.residuals(road, association, sigmas), shape);
  }

  /// Associates and solves in turns, with ever less slack.
  Hypothesis refine(const RoadShapeVector& start, const std::vector<double>& slacks) const {
    Hypothesis out;
    out.shape = start;
    for (const double slack : slacks) {
      out.association = measurements_.associate(RoadShape(options_.up, out.shape), slack);
      if (out.association.lines.empty() && out.association.crossings.empty()) {
        out.evidence = -1e9;
        return out;
      }
      solve(slack, &out);
    }
    return out;
  }

 private:
  Eigen::VectorXd widened(const RoadShape& road, const MarkingAssociation& association,
                          double slack) const {
    Eigen::VectorXd out = measurements_.sigmas(road, association);
    for (std::size_t k = 0; k < association.measurements.size(); ++k) {
      const MarkingMeasurement& m = association.measurements[k];
      double& sigma = out[static_cast<Eigen::Index>(k)];
      if (m.kind == MarkingMeasurement::Kind::kEnd) sigma = std::hypot(sigma, slack * 3.0);
      if (m.kind == MarkingMeasurement::Kind::kAcross) sigma = std::hypot(sigma, slack);
      if (m.kind == MarkingMeasurement::Kind::kWidth ||
          m.kind == MarkingMeasurement::Kind::kAzimuth ||
          m.kind == MarkingMeasurement::Kind::kLaneWidth) {
        sigma = std::hypot(sigma, slack);
      }
    }
    return out;
  }

  Eigen::VectorXd residuals_at(const RoadShapeVector& shape, const MarkingAssociation& association,
                               const Eigen::VectorXd& sigmas) const {
    return measurements_.residuals(RoadShape(options_.up, shape), association, sigmas);
  }

  /// Cauchy, beyond two standard deviations.
  static double robust_weight(double r) { return 1.0 / (1.0 + r * r / 4.0); }

  double cost(const Eigen::VectorXd& r, const MarkingAssociation& association,
              const RoadShapeVector& shape) const {
    double out = ((shape - prior_mean_).cwiseQuotient(prior_sigma_)).squaredNorm();
    for (Eigen::Index k = 0; k < r.size(); ++k) {
      out += association.measurements[static_cast<std::size_t>(k)].weight * r[k] * r[k];
    }
    return out;
  }

  /// Levenberg-Marquardt with derivatives by central differences.
  void solve(double slack, Hypothesis* h) const {
    MarkingAssociation& association = h->association;
    const Eigen::VectorXd sigmas = widened(RoadShape(options_.up, h->shape), association, slack);
    double damping = 1e-3;
    Eigen::VectorXd r = residuals_at(h->shape, association, sigmas);
    RoadShapeMatrix normal;
    constexpr int kIterations = 15;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      for (std::size_t k = 0; k < association.measurements.size(); ++k) {
        MarkingMeasurement& m = association.measurements[k];
        if (m.kind != MarkingMeasurement::Kind::kSharedWidth) {
          m.weight = robust_weight(r[static_cast<Eigen::Index>(k)]);
        }
      }
      r = residuals_at(h->shape, association, sigmas);
      Eigen::MatrixXd j(r.size(), RoadShapeVector::SizeAtCompileTime);
      for (int p = 0; p < j.cols(); ++p) {
        const double step = 1e-3 * prior_sigma_[p];
        RoadShapeVector up = h->shape, down = h->shape;
        up[p] += step;
        down[p] -= step;
        j.col(p) =
            (residuals_at(up, association, sigmas) - residuals_at(down, association, sigmas)) /
            (2.0 * step);
      }
      Eigen::VectorXd weights(r.size());
      for (Eigen::Index k = 0; k < r.size(); ++k) {
        weights[k] = association.measurements[static_cast<std::size_t>(k)].weight;
      }
      const RoadShapeVector information = prior_sigma_.cwiseAbs2().cwiseInverse();
      normal = j.transpose() * weights.asDiagonal() * j;
      normal.diagonal() += information;
      const RoadShapeVector gradient = j.transpose() * (weights.cwiseProduct(r)) +
                                       information.cwiseProduct(h->shape - prior_mean_);
      const double before = cost(r, association, h->shape);
      bool moved = false;
      for (int attempt = 0; attempt < 6 && !moved; ++attempt) {
        RoadShapeMatrix damped = normal;
        damped.diagonal() *= 1.0 + damping;
        const RoadShapeVector step = -damped.ldlt().solve(gradient);
        const RoadShapeVector there = h->shape + step;
        const Eigen::VectorXd r_there = residuals_at(there, association, sigmas);
        if (cost(r_there, association, there) < before) {
          h->shape = there;
          r = r_there;
          damping = std::max(1e-7, 0.2 * damping);
          moved = true;
          if (step.cwiseQuotient(prior_sigma_).norm() < 1e-5) iteration = kIterations;
        } else {
          damping *= 8.0;
        }
      }
      if (!moved) break;
    }
    h->covariance = normal.inverse();
    h->evidence = evidence(association, r, h->shape);
    double sum = 0.0, count = 0.0;
    for (Eigen::Index k = 0; k < r.size(); ++k) {
      const double w = association.measurements[static_cast<std::size_t>(k)].weight;
      sum += w * r[k] * r[k];
      count += w;
    }
    h->misfit = count > 0 ? sum / count : 0.0;
  }

  const MarkingMeasurements& measurements_;
  const MarkedRoadOptions& options_;
  RoadShapeVector prior_mean_, prior_sigma_;
};

/// Planes over the range of tilts and heights, with the evidence of the strokes.
std::vector<Hypothesis> search(const ShapeSolver& solver, const MarkedRoadOptions& options) {
  constexpr double kTiltStep = 0.0075, kMostTilt = 0.24, kHeightStep = 0.05, kMostHeight = 0.9;
  constexpr double kSlack = 0.05;
  constexpr std::size_t kStarts = 10;
  const int tilts = 2 * static_cast<int>(kMostTilt / kTiltStep) + 1;
  const int heights = 2 * static_cast<int>(kMostHeight / kHeightStep) + 1;
  const std::vector<double> across = {-1.0, 0.0, 1.0};
  std::vector<Hypothesis> all(static_cast<std::size_t>(tilts) * static_cast<std::size_t>(heights) *
                              across.size());
  parallel_for(static_cast<std::size_t>(tilts), options.num_threads, [&](std::size_t t) {
    for (int h = 0; h < heights; ++h) {
      for (std::size_t a = 0; a < across.size(); ++a) {
        Hypothesis& out =
            all[(t * static_cast<std::size_t>(heights) + static_cast<std::size_t>(h)) *
                    across.size() +
                a];
        out.shape = solver.prior_mean();
        out.shape[detail::kTiltAlong] = (static_cast<double>(t) - 0.5 * (tilts - 1)) * kTiltStep;
        out.shape[detail::kTiltAcross] = across[a] * options.tilt_across;
        out.shape[detail::kLogHeight] += (h - 0.5 * (heights - 1)) * kHeightStep;
        out.evidence = solver.rough_evidence(out.shape, kSlack);
      }
    }
  });
  std::stable_sort(all.begin(), all.end(), [](const Hypothesis& a, const Hypothesis& b) {
    return a.evidence > b.evidence;
  });
  // The best ones that differ.
  std::vector<Hypothesis> out;
  for (const Hypothesis& h : all) {
    if (out.size() == kStarts || h.evidence < -1e8) break;
    const bool known = std::any_of(out.begin(), out.end(), [&](const Hypothesis& o) {
      return std::abs(o.shape[detail::kLogHeight] - h.shape[detail::kLogHeight]) < 0.12 &&
             std::abs(o.shape[detail::kTiltAlong] - h.shape[detail::kTiltAlong]) < 0.02;
    });
    if (!known) out.push_back(h);
  }
  return out;
}

/// Roads that explain the strokes about as well as the best: more than so much less likely counts
/// as excluded, half squared standard deviations.
constexpr double kExcluded = 6.0;

/// Puts the likeliest hypothesis first; of several that fit the markings alike, that which
/// the known height of the camera makes likeliest.
void choose(const MarkedRoadOptions& options, std::vector<Hypothesis>* solved) {
  const auto likelier = [](const Hypothesis& a, const Hypothesis& b) {
    return a.likelihood > b.likelihood;
  };
  for (Hypothesis& h : *solved) h.likelihood = h.evidence;
  std::stable_sort(solved->begin(), solved->end(), likelier);
  if (solved->empty() || !(options.known_height > 0)) return;
  const double least = solved->front().evidence - kExcluded;
  for (Hypothesis& h : *solved) {
    if (h.evidence < least) continue;
    const double off = h.shape[detail::kLogHeight] - std::log(options.known_height);
    const double variance = h.covariance(detail::kLogHeight, detail::kLogHeight) +
                            std::pow(options.known_height_sigma / options.known_height, 2);
    h.likelihood -= std::min(0.5 * off * off / variance, kExcluded);
  }
  std::stable_sort(solved->begin(), solved->end(), likelier);
}

/// The covariance of the first hypothesis with the share of those that it cannot exclude.
/// @param evidence_of_other  of the best other one; 0: none.
RoadShapeMatrix mixed_covariance(const std::vector<Hypothesis>& solved, double* evidence_of_other) {
  constexpr double kOther = 9.0;  // squared standard deviations
  const Hypothesis& best = solved.front();
  const auto scaled = [](const Hypothesis& h) -> RoadShapeMatrix {
    return std::max(1.0, h.misfit) * h.covariance;
  };
  RoadShapeMatrix out = scaled(best), others = RoadShapeMatrix::Zero();
  double shares = 0.0;
  *evidence_of_other = 0.0;
  std::vector<RoadShapeVector> seen = {best.shape};
  for (std::size_t k = 1; k < solved.size(); ++k) {
    const Hypothesis& h = solved[k];
    if (h.likelihood < best.likelihood - kExcluded) break;
    const bool known = std::any_of(seen.begin(), seen.end(), [&](const RoadShapeVector& shape) {
      const RoadShapeVector off = h.shape - shape;
      return off.dot((best.covariance + h.covariance).ldlt().solve(off)) < kOther;
    });
    if (known) continue;
    seen.push_back(h.shape);
    if (shares == 0.0) *evidence_of_other = h.evidence;
    const double share = std::exp(h.likelihood - best.likelihood);
    const RoadShapeVector off = h.shape - best.shape;
    others += share * (off * off.transpose() + scaled(h) - scaled(best));
    shares += share;
  }
  out += others / (1.0 + shares);
  return out;
}

/// The middle of a stroke on the ground, px: half of its metres.
Eigen::Vector2d metric_middle(const RoadShape& road, const PinholeCamera& camera,
                              const PaintedStroke& stroke) {
  const double near = 1.0 / road.depth(camera.ray(stroke.near_end));
  const double far = 1.0 / road.depth(camera.ray(stroke.far_end));
  const double share = std::clamp(detail::metric_middle_share(near, far), 0.0, 1.0);
  return stroke.middle(stroke.near_end.y() + share * (stroke.far_end.y() - stroke.near_end.y()));
}

void describe_markings(const PinholeCamera& camera, const std::vector<PaintedStroke>& strokes,
                       const LaneMarkingSizes& sizes, const MarkingMeasurements& measurements,
                       const Hypothesis& best, const MarkedRoadOptions& options, MarkedRoad* out) {
  const RoadShape road(options.up, best.shape);
  // A stroke of whose places and widths most are far off is none.
  std::vector<double> sum(strokes.size(), 0.0), count(strokes.size(), 0.0);
  for (const MarkingMeasurement& m : best.association.measurements) {
    if (m.kind == MarkingMeasurement::Kind::kSharedWidth) continue;
    sum[m.stroke] += m.weight;
    count[m.stroke] += 1.0;
  }
  const auto fits = [&](std::size_t i) { return count[i] > 0 && sum[i] > 0.5 * count[i]; };
  const auto add = [&](MarkingKind kind, const PaintedStroke& stroke, double length) {
    SeenMarking m;
    m.kind = kind;
    m.pixel = metric_middle(road, camera, stroke);
    m.near_end = stroke.near_end;
    m.far_end = stroke.far_end;
    m.length = length;
    out->markings.push_back(m);
    const double near = road.depth(camera.ray(stroke.near_end));
    const double far = road.depth(camera.ray(stroke.far_end));
    out->nearest = out->nearest > 0 ? std::min(out->nearest, near) : near;
    out->farthest = std::max(out->farthest, far);
  };
  for (const std::vector<std::size_t>& line : best.association.lines) {
    for (const std::size_t i : line) {
      if (!fits(i)) continue;
      ++out->dashes;
      out->strokes.push_back(i);
      if (!strokes[i].near_seen || !strokes[i].far_seen) continue;
      add(MarkingKind::kDash, strokes[i], sizes.dash_length);
      // Side by side with another: rows in common.
      for (std::size_t j = 0; j < strokes.size(); ++j) {
        if (j == i || best.association.kinds[j] == StrokeKind::kUnknown || !fits(j)) continue;
        const double low = std::min(strokes[i].near_end.y(), strokes[j].near_end.y());
        const double high = std::max(strokes[i].far_end.y(), strokes[j].far_end.y());
        if (low - high > 0.5 * (strokes[i].near_end.y() - strokes[i].far_end.y())) {
          out->markings.back().beside = true;
        }
      }
    }
  }
  for (const std::vector<std::size_t>& stripes : best.association.crossings) {
    std::vector<std::size_t> good;
    for (const std::size_t i : stripes) {
      if (fits(i)) good.push_back(i);
    }
    if (good.size() < 3) continue;
    ++out->crossings;
    out->strokes.insert(out->strokes.end(), good.begin(), good.end());
    const PaintedStroke& middle = strokes[good[good.size() / 2]];
    add(MarkingKind::kCrossing, middle, measurements.on_road(road, middle).length);
    out->markings.back().strokes = static_cast<int>(good.size());
    out->markings.back().beside = true;
  }
  std::stable_sort(
      out->markings.begin(), out->markings.end(),
      [](const SeenMarking& a, const SeenMarking& b) { return a.near_end.y() > b.near_end.y(); });
  for (std::size_t i = 0; i < strokes.size(); ++i) {
    if (best.association.kinds[i] != StrokeKind::kLine || !fits(i)) continue;
    ++out->lines;
    out->strokes.push_back(i);
  }
}

}  // namespace

std::string to_string(MarkingKind kind) { return kind == MarkingKind::kDash ? "dash" : "crossing"; }

void MarkedRoadOptions::validate() const {
  for (const auto& [name, value] :
       {std::pair{"tilt_along", tilt_along}, std::pair{"tilt_across", tilt_across},
        std::pair{"height", height}, std::pair{"log_height", log_height},
        std::pair{"curvature", curvature}, std::pair{"curvature_change", curvature_change},
        std::pair{"twist", twist}, std::pair{"cross_curvature", cross_curvature},
        std::pair{"known_height_sigma", known_height_sigma}}) {
    if (!(value > 0.0)) {
      throw std::invalid_argument(fmt::format("{} = {}, expected > 0", name, value));
    }
  }
}

double MarkedRoad::inverse_depth(const PinholeCamera& camera, const Eigen::Vector2d& pixel) const {
  return 1.0 / RoadShape(up, shape).depth(camera.ray(pixel));
}

Eigen::Matrix<double, 1, MarkedRoad::kShape> MarkedRoad::by_shape(
    const PinholeCamera& camera, const Eigen::Vector2d& pixel) const {
  const Eigen::Vector3d ray = camera.ray(pixel);
  Eigen::Matrix<double, 1, MarkedRoad::kShape> out;
  const double steps[] = {1e-4, 1e-4, 1e-3, 1e-5, 1e-6, 1e-5, 1e-5};
  for (int p = 0; p < kShape; ++p) {
    RoadShapeVector more = shape, less = shape;
    more[p] += steps[p];
    less[p] -= steps[p];
    out[p] = (1.0 / RoadShape(up, more).depth(ray) - 1.0 / RoadShape(up, less).depth(ray)) /
             (2.0 * steps[p]);
  }
  return out;
}

UncertainPlane MarkedRoad::ego(Eigen::Matrix<double, 3, MarkedRoad::kShape>* by_shape) const {
  const RoadShape road(up, shape);
  UncertainPlane out;
  out.plane = {road.normal(), road.height()};
  out.centroid = out.plane.foot(Eigen::Vector3d::Zero());
  UncertainPlane::make_axes(road.normal(), road.ahead(), &out.axis1, &out.axis2);
  // n + (a axis1 + b axis2) x n, and the plane is raised where the camera's height falls.
  Eigen::Matrix<double, 3, MarkedRoad::kShape> j =
      Eigen::Matrix<double, 3, MarkedRoad::kShape>::Zero();
  for (const int p : {detail::kTiltAlong, detail::kTiltAcross}) {
    constexpr double kStep = 1e-5;
    RoadShapeVector more = shape;
    more[p] += kStep;
    const Eigen::Vector3d change = (RoadShape(up, more).normal() - road.normal()) / kStep;
    j(0, p) = change.dot(out.axis1.cross(road.normal()));
    j(1, p) = change.dot(out.axis2.cross(road.normal()));
  }
  j(2, detail::kLogHeight) = -road.height();
  out.covariance = j * covariance * j.transpose();
  // One slope that is off over the whole distance to what is seen.
  const double height = slope_off_shape * nearest;
  out.covariance.diagonal() +=
      Eigen::Vector3d(slope_off_shape, slope_off_shape, height).cwiseAbs2();
  if (by_shape) *by_shape = j;
  return out;
}

MarkedRoad find_marked_road(const PinholeCamera& camera, const std::vector<PaintedStroke>& strokes,
                            const LaneMarkingSizes& sizes, const MarkedRoadOptions& options) {
  options.validate();
  MarkedRoad out;
  out.status = Status::kFailed;
  out.up = options.up.normalized();
  out.slope_off_shape = options.slope_off_shape;
  if (!sizes.dashes() && !sizes.stripes()) {
    out.reason = "the scene gives no sizes of dashes or crossings (markings_m)";
    return out;
  }
  if (strokes.empty()) {
    out.reason = "no stroke of paint is seen on the road";
    return out;
  }
  const MarkingMeasurements measurements(camera, strokes, sizes, options.noise);
  const ShapeSolver solver(measurements, options);
  const std::vector<Hypothesis> starts = search(solver, options);
  std::vector<Hypothesis> solved(starts.size());
  parallel_for(starts.size(), options.num_threads, [&](std::size_t k) {
    solved[k] = solver.refine(starts[k].shape, {0.05, 0.03, 0.02, 0.01, 0.0, 0.0});
  });
  choose(options, &solved);
  if (solved.empty() || solved[0].evidence < kLeastEvidence) {
    out.reason = "no dash or crossing of the sizes given is seen whole";
    return out;
  }
  const Hypothesis& best = solved[0];
  out.shape = best.shape;
  out.covariance = mixed_covariance(solved, &out.evidence_of_other);
  out.misfit = best.misfit;
  out.evidence = best.evidence;
  describe_markings(camera, strokes, sizes, measurements, best, options, &out);
  if (out.markings.empty()) {
    out.reason = "no dash or crossing of the sizes given is seen whole";
    return out;
  }
  out.status = Status::kOk;
  return out;
}

}  // namespace camber
