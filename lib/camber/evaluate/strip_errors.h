#pragma once

#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/road/road_strip.h"
#include "camber/scene/drive_document.h"
#include "camber/scene/scene.h"

namespace camber {

struct StripErrorOptions {
  double cell = 0.5;              ///< m, of the strip, along and across, > 0
  double half_width = 4.0;        ///< m to each side of the driven line that is judged, > 0
  double view = 20.0;             ///< m from a camera that has a cell in view, > 0
  double before = 10.0;           ///< m along the driven line to the place heights are against, > 0
  double grade_length = 5.0;      ///< m along the driven line over which cells have a grade, > 0
  double grade_half_width = 2.0;  ///< m to each side, likewise, > 0

  void validate() const;  ///< @throws std::invalid_argument
};

/// Of absolute values; NaN where nothing was compared.
struct ErrorSpread {
  int count = 0;
  double median = std::numeric_limits<double>::quiet_NaN();
  double p95 = std::numeric_limits<double>::quiet_NaN();
  double mean = std::numeric_limits<double>::quiet_NaN();  ///< signed: estimate minus truth
  int with_sigma = 0;
  double within_95 = std::numeric_limits<double>::quiet_NaN();  ///< share, of those with a sigma
};

/// The road along a drive against the true one.
struct StripErrors {
  int cells = 0;     ///< of true road beside the driven line that a camera had in view
  int answered = 0;  ///< of them, those that the strip has
  /// m, of a cell against the driven line `before` behind it, all along one direction up.
  ErrorSpread height;
  /// m, the same with the estimate turned as the truth at the frame there: what the drift of the
  /// rotation adds is left out.
  ErrorSpread joined;
  /// m, of a cell against the driven line beside it, which is what its sigma states.
  ErrorSpread beside;
  ErrorSpread grade;  ///< rad, under each frame, of the cells there
  double grade_rms = std::numeric_limits<double>::quiet_NaN();
  ErrorSpread frame_grade;  ///< rad, of the frames, as drive.json states them
  double frame_grade_rms = std::numeric_limits<double>::quiet_NaN();
};

/// Errors of a drive's strip. Cells correspond to true places by the frames that pass there and by
/// their distance from the driven line, and each height is against the own driven line, so neither
/// an error of the scale nor of the heading counts. Up is the strip's, turned with the mean
/// rotation between the poses.
/// @param scene  with true poses, and ego planes where the truth has them; vehicles hide the road.
/// @param drive  frames by their id.
/// @param truth  points of the true ground; of those with a label only label 1, road.
/// @param world_from_truth  to the world of the true poses
/// @throws NoAnswerError where fewer than two frames have both poses, or the camera stands;
/// std::invalid_argument for bad options or a scene without truth.
StripErrors strip_errors(const Scene& scene, const DriveDocument& drive, const RoadStrip& strip,
                         const RoadCloud& truth, const SE3& world_from_truth,
                         const StripErrorOptions& options = {});

/// The errors of one estimate under its name.
struct EvaluatedStrip {
  std::string truth, estimate;  ///< as given
  StripErrors errors;
};

/// For a terminal, or Markdown tables.
std::string strips_text(const std::vector<EvaluatedStrip>& strips, bool markdown);
nlohmann::json to_json(const EvaluatedStrip& strip);

}  // namespace camber
