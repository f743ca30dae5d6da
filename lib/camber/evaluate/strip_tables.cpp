// The errors of strips for people and programs.

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/evaluate/detail/text_table.h"
#include "camber/evaluate/strip_errors.h"

namespace camber {
namespace {

using detail::cell;
using nlohmann::json;

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

/// @param sigma  whether the numbers have one of their own
json spread_json(const ErrorSpread& e, double unit, bool sigma) {
  json out = {{"count", e.count},
              {"median", number(unit * e.median)},
              {"p95", number(unit * e.p95)},
              {"mean", number(unit * e.mean)}};
  if (sigma) {
    out["with_sigma"] = e.with_sigma;
    out["within_95"] = number(e.within_95);
  }
  return out;
}

double share(const StripErrors& e) {
  return e.cells > 0 ? static_cast<double>(e.answered) / e.cells
                     : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

std::string strips_text(const std::vector<EvaluatedStrip>& strips, bool markdown) {
  std::vector<std::vector<std::string>> lines{{"road of", "cells", "answered %", "height, median m",
                                               "95 %", "joined, median m", "95 %",
                                               "beside the line, median m", "95 %", "in their 95 %",
                                               "grade, rms deg", "of frames", "in their 95 %"}};
  for (const EvaluatedStrip& one : strips) {
    const StripErrors& e = one.errors;
    lines.push_back({one.estimate, std::to_string(e.cells), cell(100.0 * share(e), 1),
                     cell(e.height.median, 3), cell(e.height.p95, 3), cell(e.joined.median, 3),
                     cell(e.joined.p95, 3), cell(e.beside.median, 3), cell(e.beside.p95, 3),
                     cell(100.0 * e.beside.within_95, 1), cell(kDegrees * e.grade_rms, 3),
                     cell(kDegrees * e.frame_grade_rms, 3),
                     cell(100.0 * e.frame_grade.within_95, 1)});
  }
  return strips.empty() ? std::string() : detail::table_text(lines, markdown);
}

json to_json(const EvaluatedStrip& strip) {
  const StripErrors& e = strip.errors;
  json grade = spread_json(e.grade, kDegrees, false);
  grade["rms"] = number(kDegrees * e.grade_rms);
  json frame_grade = spread_json(e.frame_grade, kDegrees, true);
  frame_grade["rms"] = number(kDegrees * e.frame_grade_rms);
  return {{"truth", strip.truth},
          {"estimate", strip.estimate},
          {"cells", e.cells},
          {"answered", e.answered},
          {"share_answered", number(share(e))},
          {"height_error", spread_json(e.height, 1.0, false)},
          {"height_error_joined", spread_json(e.joined, 1.0, false)},
          {"height_error_beside", spread_json(e.beside, 1.0, true)},
          {"grade_error_deg", std::move(grade)},
          {"frame_grade_error_deg", std::move(frame_grade)}};
}

}  // namespace camber
