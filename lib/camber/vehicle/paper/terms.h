#pragma once

#include <string>

namespace camber::paper {

/// Two readings of the paper's equations 4, 6 and 7 (see the cost functions).
enum class Terms {
  kMeant,   ///< as their text describes them: the ground's normal and offset
  kPrinted  ///< as the formulas stand
};

std::string to_string(Terms terms);  ///< "meant", "printed"
/// Inverse of to_string. @throws std::invalid_argument for another name.
Terms terms_from_string(const std::string& name);

/// The hand-set weights of the paper's terms, each as one over a standard deviation with a unit, so
/// that the answer does not depend on the unit of length. Decided on rendered scenes with even
/// numbers, reported on others: docs/notes/paper.md.
struct Weights {
  // L_r, equations 2 and 3. A cell is 1/64 of the detection box's width (u) and height (v):
  // networks see the box resized to 64 x 64 cells.
  double keypoint_seen = 1.2;    ///< cells
  double keypoint_hidden = 4.0;  ///< cells: hidden by the vehicle itself, or of low confidence
  double keypoint_place = 0.1;   ///< m, each axis, beside the cells: a car off its shape model
  /// A keypoint is seen if its confidence is at least this share of the vehicle's highest.
  double seen_confidence = 0.05;
  double ground = 0.015;            ///< m, L_g, equation 4
  double normal = 0.01;             ///< rad, L_n, equation 5
  double disambiguation = 0.05;     ///< of a cosine, L_d, equation 6
  double base_point = 0.05;         ///< m, L_b, equation 7; each of eight points
  double consistency_normal = 0.1;  ///< rad, L_c, equation 8
  double consistency_offset = 3.0;  ///< m, L_c, equation 8
  double continuity = 0.1;          ///< m, of PlaneContinuity in the place of equation 8
  double dimensions = 0.6;          ///< of the prior's standard deviations, L_reg
  double shape = 0.5;               ///< of the prior's standard deviations, L_reg
  double huber = 2.0;               ///< standard deviations, of every term, > 0
  void validate() const;            ///< throws std::invalid_argument
};

}  // namespace camber::paper
