#include "camber/scale/contradiction.h"

#include "camber/scale/fusion.h"

namespace camber {

std::optional<ContradictingScale> contradicting_scale(const RoadPosterior& prior,
                                                      const Constraint& constraint,
                                                      const ConstraintReport& report, double others,
                                                      const ScaleNoise& noise) {
  if (constraint.size() == 0) return std::nullopt;
  const double share =
      contradiction_share(report.residual_sigma, noise.contradiction_start, constraint.gate);
  if (!(share > 0.0)) return std::nullopt;
  const auto implied = implied_log_scale(prior, constraint);
  if (!implied) return std::nullopt;
  // What the road's own scale leaves open is in the variance, too.
  const double own = implied->variance - prior.scale_sigma() * prior.scale_sigma();
  if (own > noise.contradicting_scale * noise.contradicting_scale) return std::nullopt;
  const double off = implied->mean - others;
  return ContradictingScale{off, share * off * off};
}

}  // namespace camber
