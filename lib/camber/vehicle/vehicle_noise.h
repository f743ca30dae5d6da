#pragma once

namespace camber {

// Every standard deviation, share, density and gate of the vehicle estimator. Behind each value:
// its unit, where it comes from, and what measures it again:
//   [cover]     test_vehicle: share of simulated vehicles inside their stated 95 % ellipsoids
//   [steep]     bench_steep_roads: errors and stated covariances on rendered and made scenes
//   [register]  test_vehicle, VehicleRegistration.*: errors of registrations against true motions
//   assumed     no measurement is known; its effect is held by the tests and benchmarks above
// A gate is in standard deviations: a robust (Cauchy) cost s^2/2 log(1 + d^2/s^2) takes over there.

/// Errors of the keypoints' pixels, in cells: shares of the detection box's width (u) and height
/// (v). A mixture of three normal components (seen, guessed, guessed far off) and a uniform one.
struct KeypointNoise {
  /// A cell as a share of the box's side: networks see the box resized to 64 x 64 cells. The
  /// uniform component's density is one over the crop's 1 / cell_share^2 cells.
  double cell_share = 1.0 / 64.0;
  double min_cell_px = 0.2;  ///< px; assumed
  /// Cells, each axis: a seen keypoint. Simulated networks err by 1 cell, rounded to half a cell;
  /// adapted to each vehicle's residuals. [cover]
  double seen = 1.05;
  double guessed = 2.6;       ///< cells; most keypoints that the network did not see [cover]
  double guessed_far = 6.0;   ///< cells; the rest of them [cover]
  double far_share = 0.30;    ///< of the guessed ones [cover]
  double gross_share = 0.05;  ///< of all: anywhere in the crop; simulated networks have 4 % [cover]
  /// Probability that the network saw a keypoint on a side that the vehicle shows, or hides:
  /// assumed (other vehicles hide some, networks guess well). [cover]
  double seen_share_shown = 0.80, seen_share_hidden = 0.12;
  /// Log odds of having been seen, from the lowest to the highest confidence by rank; other
  /// relations were tried without change. [steep]
  double confidence_log_odds = 8.0;
  /// Log likelihood that the confidences must add to be used; assumed.
  double confidence_evidence = 3.0;
  /// Adaptation of `seen` by a factor: weight of the prior on 1, as a number of residuals, and
  /// bounds; assumed.
  double adapt_prior_count = 16.0, adapt_min = 0.8, adapt_max = 2.2;
  // Keypoints whose sigma the network states (scene.json's keypoint_sigmas_px): normal with that
  // sigma times stated_scale (neighbouring keypoints err alike), or with stated_far_scale of it, or
  // gross. Cells are those of the box's larger side there.
  /// Chosen on 182 rendered cars (2.2, 3.2, 4.5: 87, 91, 91 % in their 95 % ellipsoids) and KITTI's
  /// in 36 views (3.2, 4.5: 72, 81 %); 173 others: 87, 91 %, and 33 views: 97, 100 %. [steep]
  double stated_scale = 4.5;
  /// Beside stated_scale, of keypoints that the network takes for hidden, where the image's border
  /// cuts the box: those beyond the border are put inside it, so that the vehicle seems too far
  /// away. Chosen among 1, 2, 3, 4 and 6 on 40 rendered cars whose images were cut; on 30 others 1
  /// leaves 87 % of the centres in their 95 % ellipsoids, 0.47 m off in the median, 4 leaves 93 %,
  /// 0.31 m.
  double stated_cut_scale = 4.0;
  double stated_far_scale = 3.0;     ///< assumed
  double stated_far_share = 0.10;    ///< assumed
  double stated_gross_share = 0.02;  ///< assumed
  /// What the shape coefficients leave of a keypoint is at least this, m^2 (a bound on its weight).
  double min_shape_variance = 1e-8;
};

/// Errors of the detection box's sides.
struct BoxNoise {
  double side_share = 0.025;  ///< share of the box's side; rendered scenes' are off by 1 to 2.7 px
                              ///< [steep]; tighter is over-confident there
  double pixel_sigma = 1.0;   ///< px, beside the share; the same source
  /// px, beside the share, in place of pixel_sigma: boxes of networks (scene.json's box_sigma_px).
  /// YOLOX-Nano's upper and lower sides on KITTI are off by 1.9 px (rms) at 20 to 35 px of height,
  /// 1.9 and 3.0 to 60 px, 1.7 and 4.1 beyond (27 vehicles in full view).
  double network_pixel_sigma = 2.5;
  /// The body's outline off the prior's points, as a share of the vehicle's height in the image
  /// (3 cm), the same in all views; assumed. [cover]
  double body_share = 0.02;
  double gate = 3.0;           ///< boxes of hidden vehicles may be far off
  double border_px = 3.0;      ///< px from the image's edge: the box is cut there; assumed
  double border_sigmas = 3.0;  ///< of a side, likewise: it may be cut there; assumed
};

/// The vehicle against the plane below it.
struct ContactNoise {
  double sigma_height = 0.012;  ///< m: suspension, unevenness; assumed [cover]
  double sigma_tilt = 0.006;    ///< rad, likewise [cover]
  /// A plane may be plainly wrong. From 2.4 and 3 on nothing was better. [steep]
  double gate = 4.0;
  double contradiction = 5.0;  ///< gate beyond which the answer is weak
};

/// Size and shape beside the prior's own distribution (shape_prior.h).
struct FormNoise {
  /// The middle of the box off that of the keypoints, as a share of its sides: bumpers, roofs and
  /// mirrors of one car reach farther beyond its keypoints than those of another (1.7 cm along a
  /// car). With 0.01 98 % of the synthetic cars are inside their 95 %. [steep] [cover]
  double centre_share = 0.004;
  double min_size_share = 0.3;  ///< of the mean size, while it is refined; assumed
};

/// Changes of pose from one view to the next.
struct MotionNoise {
  // Of a parked vehicle, beside the cameras' own errors: what the cameras' motion leaves. A quarter
  // to a half of the shift and a fifth of the turn changed little. [steep]
  double parked_shift = 0.002;  ///< m
  double parked_turn = 0.001;   ///< rad
  // Of a moving one, for each second; assumed, and narrow enough that slow ones are seldom taken
  // for parked (docs/notes/vehicles-several-views.md). Rendered vehicles drive at constant speed.
  double sideways = 0.2;       ///< m / s, off its heading on the road: slip where it turns
  double vertical = 0.1;       ///< m / s, off its heading, likewise
  double turning = 0.25;       ///< rad / s, about its vertical axis
  double tilting = 0.1;        ///< rad / s, about the other two
  double acceleration = 2.0;   ///< m / s^2
  double speed = 15.0;         ///< m / s, standard deviation of its speed
  double min_interval = 1e-3;  ///< s, between views
};

/// Registration of a vehicle between images.
struct RegistrationNoise {
  /// Each image's own error of the body (sampling, reflections): px of its place, and px of its
  /// growth at the outline. True motions of 84 registrations beyond 15 m: 0.05 to 0.12 and 0.10 to
  /// 0.16, robustly, with longer tails. [register] [steep]
  double place_px = 0.1, growth_px = 0.12;
  double growth_share = 0.05;  ///< of the growth: neighbouring pixels of unlike depth; assumed
  double body_depth = 0.15;    ///< m, of the body off the hull of its keypoints [steep]
  /// Pixels whose residuals are as one: 4 pi sigma^2 of the last level's blur.
  double correlated_pixels = 8.0;
  double min_correlation = 0.9;  ///< of intensities; below, registrations were 0.6 to 1.3 px off
  double outlier_scale = 3.0;    ///< of an intensity's residual, in robust standard deviations
  double gate = 3.0;             ///< it may have failed
};

/// When a hypothesis is pruned, preferred or ambiguous. Differences of log posteriors; assumed,
/// held by the tests on swapped and turned vehicles. [steep]
struct HypothesisGates {
  double pruned = 25.0;            ///< a start so much worse than the best
  double same_heading = 0.35;      ///< rad: two starts are one hypothesis
  double swap_evidence = 3.0;      ///< that mirrored names must add
  double rival_heading = 3.0;      ///< a rival that is not so much worse leaves the answer weak
  double heading_evidence = 15.0;  ///< a view of a track counts for no more, and is dropped if it
                                   ///< contradicts the chosen heading by more
  double same_axis = 0.9;       ///< cosine of the headings of views of one track, but for the sense
  double parked_pruned = 60.0;  ///< the parked hypothesis so much worse than the moving one
  /// That one vehicle may add to another focal length. With the true one the most was 5.2, with
  /// twice it 12 (390 and 135 runs over rendered roads with near vehicles, even numbers).
  double focal_length_most = 8.0;
  /// m, of the vehicles that are compared the depth, the shorter of those with the two focal
  /// lengths
  double focal_length_farthest = 18.0;
  // Starts of a heading: robust scales of the reweighted linear problem, in cells, the last one to
  // the end; least weight of a keypoint that is not seen; m, beside the plane's own height.
  double start_scales[3] = {24.0, 12.0, 5.0};
  double start_min_seen = 0.3;
  double start_height_sigma = 0.05;
};

/// When an answer is weak or not used; assumed.
struct AnswerGates {
  double agreeing_keypoints = 5.0;  ///< expected number that is not far off, at least,
  double agreeing_share = 0.3;      ///< and this share of them
  double box_overlap = 0.4;         ///< IoU of the predicted box with the detection's, at least
  /// Of the class's mean length, width and height, at least. Detections of two vehicles that were
  /// taken for one made it 0.35. [steep]
  double least_size = 0.55;
  /// Standard deviations along the viewing ray between what a source (planes, registration) and the
  /// rest of the evidence ask for: to the first they agree, from the second on the answer without
  /// the source counts as one standard deviation. [steep]
  double source_agrees = 1.5, source_contradicts = 2.5;
  double relative_sigma = 0.08;  ///< of the position over the distance, at most
};

/// Association of detections into tracks.
struct AssociationGates {
  double overlap = 0.3;  ///< IoU with a predicted box, at least; assumed
  /// m/s, standard deviation of a vehicle's speed: an overlap with the box of one that drives
  /// counts by the normal density's share of its peak. Without, rendered tracks of cars one behind
  /// the other were exchanged. [steep]
  double speed = 25.0;
};

/// Message passing over the ground planes.
struct GroundMessageNoise {
  double gate = 4.0;  ///< Mahalanobis distance of a message, as planes in the fits [steep]
};

struct VehicleNoise {
  KeypointNoise keypoint;
  BoxNoise box;
  ContactNoise contact;
  FormNoise form;
  MotionNoise motion;
  RegistrationNoise registration;
  HypothesisGates hypotheses;
  AnswerGates answer;
  AssociationGates association;
  GroundMessageNoise message;
  void validate() const;  ///< throws std::invalid_argument with name, value and bound
};

/// How well a plane that is handed in without a covariance is taken to be known.
struct SupportOptions {
  double given_sigma_height = 0.010;  ///< m, a local plane given with the detection; > 0; assumed
  double given_sigma_tilt = 0.004;    ///< rad; > 0; assumed
  double ego_sigma_height = 0.02;     ///< m, at the foot below the camera; > 0; assumed
  double ego_sigma_tilt = 0.03;       ///< rad: how much a road's slope changes ahead; > 0; assumed
  double level_sigma_height = 0.05;   ///< m, at the foot below the camera; > 0; assumed
  double level_sigma_tilt = 0.06;     ///< rad; > 0; assumed
  /// m, SupportPlane::unmodelled_height of a plane of the road. [steep]
  double road_unmodelled_height = 0.05;
  void validate() const;  ///< throws std::invalid_argument
};

}  // namespace camber
