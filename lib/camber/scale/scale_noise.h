#pragma once

namespace camber {

/// Standard deviations, correlation lengths and gates of the sources of scale, with where each was
/// measured. "Rendered roads": the vehicles' and markings' tables of bench_steep_roads and
/// bench_main_job, which measure them again.
struct ScaleNoise {
  /// Standard deviations from which on a measurement contradicts another: one length of markings or
  /// one change of a road's width those beside it; the plane search, intensities, a vehicle, a turn
  /// or broken lines the result.
  double gate = 3.0;
  /// Relative, of a scale that is hardly known: one source that knows it worse by itself
  /// contradicts none (a road's width, which measures its shape, knows it to a factor), and where
  /// the road may be another layer, or markings contradict it altogether, it is known no better
  /// (assumed).
  double hardly_known = 0.3;

  // The camera's mounting.
  double unknown_camera_height = 1.65;        ///< m, of a camera on a car to a van
  double unknown_camera_height_sigma = 0.33;  ///< m; 20 %
  /// Relative standard deviation of a scale beyond which a result is called up to scale that has no
  /// camera height and no known poses, or whose pictures repeat the asphalt.
  double metric_limit = 0.1;

  double known_pose_scale =
      0.01;  ///< relative, of baselines between poses that a scene gives (assumed)

  /// Relative, of the path between given positions whose poses the matches contradict (assumed).
  double contradicted_path = 0.02;

  // The speed.
  double speed_path = 0.005;  ///< relative, of the path's length in baselines (assumed)

  /// Standard deviations between one source and the others from which on the scale is widened, by
  /// ever more of what they differ by up to the source's gate.
  double contradiction_start = 2.0;
  /// Share of a mask's road that has to be found in the other images: where less is, it may be
  /// found at another layer (made scenes, even numbers: 0.36 and more; one at 0.04 to 0.10 is up to
  /// 39 % off). The scale is then `hardly_known`.
  double least_found = 0.2;
  /// The same where the plane search finds no road either (even numbers: right ones from 0.39 on;
  /// one at 0.32 is 90 % off).
  double least_found_alone = 0.35;
  /// The same where the plane search finds two roads: another one may be found at (rendered roads
  /// whose texture repeats, even numbers, masks: wrong ones have 0.40 to 0.76).
  double least_found_ambiguous = 0.65;
  /// Share of what is matched over the driven path that may stand on it or lie below it where no
  /// mask shows the road: with more it is likely another layer (steep and made scenes, even
  /// numbers: two of 160 have more, 84 and 30 % off, and one 10 % off). Then likewise.
  double most_off_road = 0.5;
  /// Share of what is matched beside a mask's road that may obstruct the driven path (steep and
  /// made scenes, even numbers: at most 0.011 in 220 runs).
  double most_obstacles = 0.05;
  /// Share of the points near the driven path that have to agree with one road (rendered scenes: in
  /// 360 sound runs 0.72 and more do, in three that were wrong by half and more a quarter).
  double least_agreeing = 0.5;
  /// Relative, of the scale, times the square of the share of a mask's road that is not found: what
  /// is found of it may be what the road mirrors, or a neighbouring repetition of its texture (even
  /// numbers, rendered roads of which less than half is found: 34 runs, two of one wet road 5.5 and
  /// 3.2 standard deviations off without).
  double unfound_share = 0.08;

  // Painted markings of known size.
  double painted_end = 0.02;   ///< m, ends of paint off their place (assumed; rendered roads agree)
  double painted_size = 0.01;  ///< relative, sizes of one road's paint off the given ones (assumed)
  double mark_column_px = 0.2;   ///< px, a stroke's middle line (tests of the detector)
  double mark_end_row_px = 0.3;  ///< px, the end of a stroke of many rows (tests of the detector)

  // Painted markings in one image alone (bench single_image_markings, even seeds).
  double stroke_edge_px = 0.15;  ///< px, an edge of a stroke over a third of its rows
  /// Relative, of all strokes' widths together off the given one, and of a piece of a stroke off
  /// that.
  double painted_width = 0.03;
  double painted_lane = 0.02;  ///< relative, of a lane's width off the given one (assumed)
  double stroke_turn = 0.01;   ///< rad, between strokes that run side by side

  // The road's width.
  double width_walk = 0.01;         ///< of the width's logarithm over width_walk_length (assumed)
  double width_walk_length = 10.0;  ///< m
  /// m, by which an edge is off its place, and the ground at it off the field (rendered roads).
  double road_edge = 0.02;
  double other_road_edge = 0.12;     ///< m, the same from one side of a gap to the other (a kerb)
  double edge_column_px = 0.25;      ///< px, that all rows of a place share
  double rows_with_one_error = 4.0;  ///< neighbouring rows of an edge

  /// rad, between the travel and the optical axis in plan: a camera that looks ahead turns less.
  double most_aside = 0.21;
  /// m, of a camera ahead of the rear axle: in a turn it travels to the inside of where the vehicle
  /// heads, by this over the radius (kinematic bicycle model).
  double most_ahead_of_axle = 3.0;

  // The plane search.
  double searched_height =
      0.05;                   ///< relative, of the camera's height in baselines (rendered roads)
  double search_lead = 0.10;  ///< of the correlation over that with the ego plane's height
  double search_correlation = 0.6;  ///< from which on the search may contradict

  // Vehicles' sizes together.
  /// Relative, of all cars of a street off the size prior together: where they are fused (assumed),
  /// and where they are compared with the road (rendered roads: 0 and 5 %).
  double vehicle_population = 0.02;
  double compared_population = 0.04;
  /// Degrees of freedom, and spread in standard deviations as stated, of Student's distribution of
  /// one vehicle's scale over the true one: 313 vehicles of 30 rendered roads.
  double vehicle_size_freedom = 3.0;
  double vehicle_size_spread = 0.9;
  /// Standard deviations, as contradiction_start, and from which on they are named: of 470 runs
  /// over rendered roads, even numbers, the two whose scales are 11 and 35 % off are beyond 1.7.
  double vehicle_sizes_start = 1.6;
  double vehicle_sizes_gate = 1.9;
  /// Standard deviations, of another focal length by the vehicles' proportions: with the true one
  /// the largest of 564 runs over rendered roads, even numbers, were 3.6, 3.4 and 3.4.
  double focal_length_gate = 3.8;

  // The focal length by a turning camera's epipolar lines.
  double focal_length = 0.05;      ///< relative, of lenses and flow that bend what is straight
  double dash_focal_length = 0.1;  ///< relative, of one by the strokes of broken lines
  /// Log likelihood of the vehicles' proportions against that one from which on the strokes are of
  /// other sizes (rendered roads, even numbers: of right ones at most 1.5 in 43 runs, of the
  /// three wrong ones 9.1, 2.2 and less).
  double vehicles_against_dashes = 2.0;
};

}  // namespace camber
