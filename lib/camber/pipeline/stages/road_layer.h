#pragma once

#include "camber/motion/correspondences.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/scale/scale_evidence.h"

namespace camber {

/// What shows whether the layer that was found is the road, or what it mirrors, another repetition
/// of its texture, or a shadow that moves: shares, each measured once.
struct RoadLayer {
  enum class Search {
    kNone,         ///< the plane search found no road
    kAmbiguous,    ///< it found several
    kInformative,  ///< it found one
  };

  bool masked = false;  ///< a mask shows where the road is
  bool posed = false;   ///< the lengths are those of given poses, and do not hang on the layer
  Search search = Search::kNone;
  double found = 1.0;     ///< of the wanted points of the ground, in the other images
  double agreeing = 1.0;  ///< of the points near the driven path, with the ego plane's road
  /// Of the matches over the driven path, up to where its road is seen well, those that stand on it
  /// lower than the camera or lie below it; where a mask shows the road, the others are not
  /// matched.
  double off_road = 0.0;
  /// With a mask: of the matches of what stands still and is no road by it, those that would stand
  /// on the first metres of the driven path.
  double obstacles = 0.0;
  /// Of the logarithm of the scale: the most by which roads from other starts, on which as many
  /// points agree, differ from this one.
  double alternative_spread = 0.0;
  bool repeated = false;  ///< the pictures repeat the asphalt, as a film's coder does

  /// Logarithm of the odds that another layer was found. Linear in the shares; assumed: each alone
  /// gives even odds where the judge calls it contradicted (ScaleNoise).
  double log_odds() const;
};

/// As evidence: it measures no scale, and the probability that the others know nothing is that of
/// another layer.
ScaleEvidence evidence_of(const RoadLayer& layer);

namespace stages {

/// @param metres_per_baseline  of the result.
RoadLayer road_layer(const LoadedFrames& frames, const Correspondences& matches,
                     const PhotometricGround& ground, double metres_per_baseline, int num_threads);

/// Share of the wanted points of the ground that are found in the other images.
double found_share(const GroundPoints& seen);

/// That share times the share of the points near the driven path that agree with the ego plane's
/// road: little where what is matched lies on another layer.
double road_agreement(const Ground& ground);

}  // namespace stages
}  // namespace camber
