// A comparison as text, JSON and tables.

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "camber/evaluate/compare.h"

namespace camber {
namespace {

nlohmann::json number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

nlohmann::json to_json(const DistanceSummary& s) {
  return {{"count", s.count},
          {"mean", number(s.mean)},
          {"median", number(s.median)},
          {"rms", number(s.rms)},
          {"quantile_90", number(s.quantile_90)},
          {"quantile_95", number(s.quantile_95)},
          {"largest", number(s.largest)}};
}

nlohmann::json to_json(const DirectedDistances& distances) {
  nlohmann::json out = to_json(distances.summary);
  out["points"] = distances.points.size();
  out["not_finite"] = distances.not_finite;
  out["outside"] = distances.outside;
  out["unobserved"] = distances.unobserved;
  if (distances.along_normal.count > 0) out["along_normal"] = to_json(distances.along_normal);
  return out;
}

}  // namespace

std::string describe(const CloudComparison& c) {
  const char* const unit = c.metric ? "m" : "units";
  std::string out = c.metric ? "" : "up to scale: lengths are in units of unknown size\n";
  if (c.alignment.alignment != Alignment::kNone) {
    out += fmt::format(
        "aligned ({}): scale {:.6f}, residual {:.4f} -> {:.4f} {} over {} pairs; estimate moved "
        "by\n",
        to_string(c.alignment.alignment), c.alignment.scale, c.alignment.residual_before,
        c.alignment.residual_after, unit, c.alignment.pairs);
    // Map coordinates are thousands of kilometres: 1e-12 of them is less than 0.01 mm.
    for (int r = 0; r < 4; ++r) {
      out += fmt::format("  {:15.12f} {:15.12f} {:15.12f} {:14.6f}\n", c.alignment.transform(r, 0),
                         c.alignment.transform(r, 1), c.alignment.transform(r, 2),
                         c.alignment.transform(r, 3));
    }
  }
  out += fmt::format(
      "{:<6}                   points     mean   median      rms      90%      95%      max\n",
      c.metric ? "metres" : "units");
  const auto row = [&](const char* name, const DistanceSummary& s) {
    out += fmt::format("{:<20} {:>10} {:8.4f} {:8.4f} {:8.4f} {:8.4f} {:8.4f} {:8.3f}\n", name,
                       s.count, s.mean, s.median, s.rms, s.quantile_90, s.quantile_95, s.largest);
  };
  row("accuracy", c.accuracy.summary);
  if (c.accuracy.along_normal.count > 0) row("  along the normal", c.accuracy.along_normal);
  row("completeness", c.completeness.summary);
  if (c.completeness.along_normal.count > 0) row("  along the normal", c.completeness.along_normal);
  const auto left_out = [&](const char* name, const DirectedDistances& distances) {
    if (distances.not_finite + distances.outside + distances.unobserved == 0) return;
    out +=
        fmt::format("not counted of the {}: {} not finite, {} outside the region, {} unobserved\n",
                    name, distances.not_finite, distances.outside, distances.unobserved);
  };
  left_out("estimate", c.accuracy);
  left_out("truth", c.completeness);
  out += "threshold   precision   recall   F-score\n";
  for (const ThresholdScore& s : c.scores) {
    out += fmt::format("{:7.3f} {}{:{}.2f} %{:7.2f} %{:8.2f} %\n", s.threshold, unit,
                       100.0 * s.precision, c.metric ? 11 : 7, 100.0 * s.recall, 100.0 * s.f_score);
  }
  if (!c.road.empty()) {
    out += "road frame            points  height mean  |median|      rms   along rms  across rms\n";
    for (const RoadErrors& r : c.road) {
      if (r.count == 0) continue;
      std::string name = "all";
      if (r.by != "all") {
        const char* const bound = r.by != "distance" ? " deg" : c.metric ? " m" : "";
        name = std::isfinite(r.to) ? fmt::format("{} {:g}-{:g}{}", r.by, r.from, r.to, bound)
                                   : fmt::format("{} > {:g}{}", r.by, r.from, bound);
      }
      out +=
          fmt::format("{:<17} {:>10} {:+12.4f} {:9.4f} {:8.4f} {:11.4f} {:11.4f}\n", name, r.count,
                      r.height_mean, r.height_median, r.height_rms, r.along_rms, r.across_rms);
    }
  }
  return out;
}

nlohmann::json to_json(const CloudComparison& c) {
  nlohmann::json out = {{"metric", c.metric}};
  nlohmann::json alignment = {{"kind", to_string(c.alignment.alignment)}};
  if (c.alignment.alignment != Alignment::kNone) {
    std::vector<double> rows;
    for (int i = 0; i < 16; ++i) rows.push_back(c.alignment.transform(i / 4, i % 4));
    alignment["from_pairs"] = c.alignment.from_pairs;
    alignment["aligned_from_estimate"] = rows;
    alignment["scale"] = c.alignment.scale;
    alignment["residual_before"] = number(c.alignment.residual_before);
    alignment["residual_after"] = number(c.alignment.residual_after);
    alignment["pairs"] = c.alignment.pairs;
    alignment["iterations"] = c.alignment.iterations;
  }
  out["alignment"] = alignment;
  out["accuracy"] = to_json(c.accuracy);
  out["completeness"] = to_json(c.completeness);
  out["scores"] = nlohmann::json::array();
  for (const ThresholdScore& s : c.scores) {
    out["scores"].push_back({{"threshold", s.threshold},
                             {"precision", s.precision},
                             {"recall", s.recall},
                             {"f_score", s.f_score}});
  }
  out["road"] = nlohmann::json::array();
  for (const RoadErrors& r : c.road) {
    const char* const from = r.by == "grade" ? "from_deg" : "from";
    const char* const to = r.by == "grade" ? "to_deg" : "to";
    out["road"].push_back({{"by", r.by},
                           {from, r.from},
                           {to, number(r.to)},
                           {"count", r.count},
                           {"height_mean", number(r.height_mean)},
                           {"height_median", number(r.height_median)},
                           {"height_rms", number(r.height_rms)},
                           {"along_rms", number(r.along_rms)},
                           {"across_rms", number(r.across_rms)}});
  }
  return out;
}

std::string scores_csv(const CloudComparison& c) {
  std::string out = "threshold,precision,recall,f_score\n";
  for (const ThresholdScore& s : c.scores) {
    out += fmt::format("{},{},{},{}\n", s.threshold, s.precision, s.recall, s.f_score);
  }
  return out;
}

std::string road_errors_csv(const CloudComparison& c) {
  std::string out = "by,from,to,count,height_mean,height_median,height_rms,along_rms,across_rms\n";
  for (const RoadErrors& r : c.road) {
    out += fmt::format("{},{},{},{},{},{},{},{},{}\n", r.by, r.from, r.to, r.count, r.height_mean,
                       r.height_median, r.height_rms, r.along_rms, r.across_rms);
  }
  return out;
}

std::string height_map_csv(const HeightErrorMap& map) {
  std::string out = "u,v,height_error,count\n";
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                             static_cast<std::size_t>(x);
      if (map.count[at] == 0) continue;
      out += fmt::format("{:.4f},{:.4f},{:.5f},{}\n", map.u + (x + 0.5) * map.cell,
                         map.v + (y + 0.5) * map.cell, map.error[at], map.count[at]);
    }
  }
  return out;
}

}  // namespace camber
