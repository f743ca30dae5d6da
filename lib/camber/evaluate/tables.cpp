#include "camber/evaluate/tables.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/core/csv_field.h"
#include "camber/core/errors.h"
#include "camber/evaluate/detail/text_table.h"

namespace camber {

namespace {

using detail::cell;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kDegrees = 180.0 / 3.14159265358979323846;
constexpr double kEllipsoid95 = 7.814728;  // chi-square, three degrees of freedom
constexpr double kInterval95 = 1.959964;   // normal

nlohmann::json number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

nlohmann::json summary_json(const ErrorSummary& s, double unit) {
  return {{"count", s.count},
          {"mean", number(s.mean * unit)},
          {"std", number(s.deviation * unit)},
          {"median", number(s.median * unit)},
          {"p90", number(s.p90 * unit)}};
}

struct Placed {
  const EvaluatedScene* scene;
  const VehicleError* error;
};

bool in_subset(const Placed& placed, const std::vector<SubsetEntry>& subset) {
  return std::any_of(subset.begin(), subset.end(), [&](const SubsetEntry& entry) {
    return entry.scene == placed.scene->scene &&
           (entry.frame < 0 || entry.frame == placed.error->frame) &&
           (entry.vehicle < 0 || entry.vehicle == placed.error->truth_id);
  });
}

LocalisationRow make_row(const std::string& name, const std::vector<Placed>& vehicles) {
  LocalisationRow row;
  row.name = name;
  std::vector<double> center, height, normal, yaw, keypoint;
  int ellipsoids = 0, inside = 0, intervals = 0, heights_inside = 0;
  auto keep = [](std::vector<double>& list, double value) {
    if (std::isfinite(value)) list.push_back(std::abs(value));
  };
  for (const Placed& placed : vehicles) {
    const VehicleError& e = *placed.error;
    ++row.matched;
    if (!e.answered) {
      ++row.unanswered;
      continue;
    }
    keep(center, e.center_error);
    keep(height, e.height_error);
    keep(normal, e.normal_error);
    keep(yaw, e.yaw_error);
    keep(keypoint, e.keypoint_error);
    if (!std::isnan(e.center_mahalanobis)) {  // infinite: outside
      ++ellipsoids;
      inside += e.center_mahalanobis <= kEllipsoid95 ? 1 : 0;
    }
    if (std::isfinite(e.height_error) && std::isfinite(e.height_sigma)) {
      ++intervals;
      heights_inside += std::abs(e.height_error) <= kInterval95 * e.height_sigma ? 1 : 0;
    }
  }
  row.center = summarise(center);
  row.height = summarise(height);
  row.normal = summarise(normal);
  row.yaw = summarise(yaw);
  row.keypoint = summarise(keypoint);
  row.center_within_95 = ellipsoids > 0 ? static_cast<double>(inside) / ellipsoids : kNaN;
  row.height_within_95 = intervals > 0 ? static_cast<double>(heights_inside) / intervals : kNaN;
  return row;
}

std::string share_cell(double value) {
  return std::isfinite(value) ? fmt::format("{:.0f} %", 100.0 * value) : std::string("-");
}

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const std::string& word : words) out += (out.empty() ? "" : ", ") + word;
  return out;
}

bool is_of(const EvaluatedScene& scene, const MethodTables& table) {
  return scene.method == table.method && scene.preset == table.preset &&
         scene.paper_terms == table.paper_terms;
}

std::string heading(const MethodTables& t) {
  std::string out =
      fmt::format("{}: {} scenes, {} vehicles counted, {} found, recall {:.1f} %, {} unanswered",
                  method_label(t.method, t.preset, t.paper_terms), t.scenes, t.counted, t.matched,
                  100.0 * t.recall, t.unanswered);
  const std::string sources = joined(t.detections_sources);
  if (!sources.empty()) out += "; detections: " + sources;
  if (t.unjudged > 0) {
    out += fmt::format("; {} more in frames without results are not counted", t.unjudged);
  }
  if (t.without_covariance > 0) {
    out += fmt::format("; {} without a covariance", t.without_covariance);
  }
  if (t.singular_covariance > 0) {
    out += fmt::format("; {} with a singular covariance", t.singular_covariance);
  }
  return out;
}

std::string marking(const MethodTables& t) {
  std::vector<std::string> marks;
  if (t.unanswered_share > kMarkedUnansweredShare) {
    marks.push_back(fmt::format("{:.1f} % of the detections are unanswered (more than {:.0f} %)",
                                100.0 * t.unanswered_share, 100.0 * kMarkedUnansweredShare));
  }
  if (t.up_to_scale > 0) {
    marks.push_back(fmt::format("{} of {} results are up to scale, their errors are no metres",
                                t.up_to_scale, t.scenes));
  }
  return marks.empty() ? "" : fmt::format("MARKED: {}", fmt::join(marks, "; "));
}

const std::vector<std::string>& column_names() {
  static const std::vector<std::string> names = {
      "distance",   "n",       "mean (std) m", "median m",       "p90 m",         "height m",
      "normal deg", "yaw deg", "keypoints m",  "centre in 95 %", "height in 95 %"};
  return names;
}

std::vector<std::string> row_cells(const LocalisationRow& r) {
  return {r.name,
          std::to_string(r.center.count),
          cell(r.center.mean, 3) + " (" + cell(r.center.deviation, 3) + ")",
          cell(r.center.median, 3),
          cell(r.center.p90, 3),
          cell(r.height.median, 3),
          cell(r.normal.median * kDegrees, 2),
          cell(r.yaw.median * kDegrees, 2),
          cell(r.keypoint.median, 3),
          share_cell(r.center_within_95),
          share_cell(r.height_within_95)};
}

}  // namespace

std::vector<SubsetEntry> read_subset(const std::filesystem::path& path) {
  std::ifstream in(path);
  if (!in || std::filesystem::is_directory(path)) {
    throw InputError(path.string(), "cannot be read");
  }
  std::vector<SubsetEntry> out;
  std::string line;
  for (int row = 1; std::getline(in, line); ++row) {
    line = line.substr(0, line.find('#'));
    std::istringstream words(line);
    SubsetEntry entry;
    entry.line = row;
    if (!(words >> entry.scene)) continue;
    std::string word;
    int* const fields[] = {&entry.frame, &entry.vehicle};
    for (int i = 0; words >> word; ++i) {
      std::size_t used = 0;
      int value = -1;
      try {
        value = std::stoi(word, &used);
      } catch (const std::exception&) {
        used = 0;
      }
      if (i >= 2 || used != word.size() || value < 0) {
        throw InputError(path.string(), fmt::format("line {}", row),
                         "expected \"scene [frame [vehicle]]\"");
      }
      *fields[i] = value;
    }
    out.push_back(entry);
  }
  if (out.empty()) throw InputError(path.string(), "found no entry, expected a scene's name");
  return out;
}

ErrorSummary summarise(std::vector<double> values) {
  ErrorSummary out;
  out.count = static_cast<int>(values.size());
  out.mean = out.deviation = out.median = out.p90 = kNaN;
  if (values.empty()) return out;
  std::sort(values.begin(), values.end());
  double sum = 0.0, squares = 0.0;
  for (const double v : values) sum += v;
  out.mean = sum / out.count;
  for (const double v : values) squares += (v - out.mean) * (v - out.mean);
  if (out.count > 1) out.deviation = std::sqrt(squares / (out.count - 1));
  auto quantile = [&](double share) {
    const double at = share * (out.count - 1);
    const auto below = static_cast<std::size_t>(at);
    const std::size_t above = std::min(below + 1, values.size() - 1);
    return values[below] + (at - static_cast<double>(below)) * (values[above] - values[below]);
  };
  out.median = quantile(0.5);
  out.p90 = quantile(0.9);
  return out;
}

std::string method_label(const std::string& method, const std::string& preset,
                         const std::string& paper_terms) {
  if (preset != "paper") return method;
  return method + (paper_terms == "printed" ? " (paper printed)" : " (paper)");
}

std::vector<MethodTables> make_tables(const std::vector<EvaluatedScene>& scenes,
                                      const std::vector<SubsetEntry>& subset) {
  std::vector<MethodTables> out;
  for (const EvaluatedScene& scene : scenes) {
    auto found = std::find_if(out.begin(), out.end(),
                              [&](const MethodTables& t) { return is_of(scene, t); });
    if (found == out.end()) {
      out.emplace_back();
      found = out.end() - 1;
      found->method = scene.method;
      found->preset = scene.preset;
      found->paper_terms = scene.paper_terms;
    }
    ++found->scenes;
    found->counted += scene.metrics.counted;
    found->matched += static_cast<int>(scene.metrics.vehicles.size());
    found->missed += scene.metrics.missed;
    found->unanswered += scene.metrics.unanswered;
    found->without_covariance += scene.metrics.without_covariance;
    found->singular_covariance += scene.metrics.singular_covariance;
    found->unjudged += scene.metrics.unjudged;
    found->up_to_scale += scene.metric ? 0 : 1;
    std::vector<std::string>& sources = found->detections_sources;
    if (!scene.detections_source.empty() &&
        std::find(sources.begin(), sources.end(), scene.detections_source) == sources.end()) {
      sources.push_back(scene.detections_source);
    }
  }
  struct Range {
    const char* name;
    double above, to;
  };
  const Range ranges[] = {{"all", -1.0, 1e9},
                          {"<= 15 m", -1.0, 15.0},
                          {"> 15 m", 15.0, 1e9},
                          {"<= 30 m", -1.0, 30.0},
                          {"> 30 m", 30.0, 1e9}};
  for (MethodTables& table : out) {
    table.recall = table.counted > 0
                       ? static_cast<double>(table.matched - table.unanswered) / table.counted
                       : kNaN;
    table.unanswered_share =
        table.matched > 0 ? static_cast<double>(table.unanswered) / table.matched : 0.0;
    std::vector<Placed> all;
    for (const EvaluatedScene& scene : scenes) {
      if (!is_of(scene, table)) continue;
      for (const VehicleError& error : scene.metrics.vehicles) all.push_back({&scene, &error});
    }
    for (const Range& range : ranges) {
      std::vector<Placed> chosen;
      for (const Placed& placed : all) {
        if (placed.error->distance > range.above && placed.error->distance <= range.to) {
          chosen.push_back(placed);
        }
      }
      table.rows.push_back(make_row(range.name, chosen));
    }
    if (!subset.empty()) {
      std::vector<Placed> chosen;
      for (const Placed& placed : all) {
        if (in_subset(placed, subset)) chosen.push_back(placed);
      }
      table.rows.push_back(make_row("subset", chosen));
    }
  }
  return out;
}

std::string tables_text(const std::vector<MethodTables>& tables) {
  std::string out;
  for (const MethodTables& table : tables) {
    out += heading(table) + "\n";
    const std::string mark = marking(table);
    if (!mark.empty()) out += mark + "\n";
    std::vector<std::vector<std::string>> lines{column_names()};
    for (const LocalisationRow& row : table.rows) lines.push_back(row_cells(row));
    out += detail::table_text(lines, false);
  }
  return out;
}

std::string tables_markdown(const std::vector<MethodTables>& tables) {
  std::string out;
  for (const MethodTables& table : tables) {
    if (!out.empty()) out += "\n";
    out += heading(table) + "\n\n";
    const std::string mark = marking(table);
    if (!mark.empty()) out += "**" + mark + "**\n\n";
    std::vector<std::vector<std::string>> lines{column_names()};
    for (const LocalisationRow& row : table.rows) lines.push_back(row_cells(row));
    out += detail::table_text(lines, true);
  }
  return out;
}

nlohmann::json tables_json(const std::vector<MethodTables>& tables) {
  nlohmann::json out = nlohmann::json::array();
  for (const MethodTables& table : tables) {
    nlohmann::json rows = nlohmann::json::array();
    for (const LocalisationRow& row : table.rows) {
      rows.push_back({{"name", row.name},
                      {"matched", row.matched},
                      {"unanswered", row.unanswered},
                      {"center_error", summary_json(row.center, 1.0)},
                      {"height_error", summary_json(row.height, 1.0)},
                      {"normal_error_deg", summary_json(row.normal, kDegrees)},
                      {"yaw_error_deg", summary_json(row.yaw, kDegrees)},
                      {"keypoint_error", summary_json(row.keypoint, 1.0)},
                      {"center_within_95", number(row.center_within_95)},
                      {"height_within_95", number(row.height_within_95)}});
    }
    out.push_back({{"method", table.method},
                   {"preset", table.preset},
                   {"paper_terms", table.paper_terms},
                   {"detections_sources", table.detections_sources},
                   {"scenes", table.scenes},
                   {"counted", table.counted},
                   {"matched", table.matched},
                   {"missed", table.missed},
                   {"unjudged", table.unjudged},
                   {"unanswered", table.unanswered},
                   {"without_covariance", table.without_covariance},
                   {"singular_covariance", table.singular_covariance},
                   {"recall", number(table.recall)},
                   {"up_to_scale", table.up_to_scale},
                   {"marked", !marking(table).empty()},
                   {"rows", rows}});
  }
  return out;
}

std::string vehicles_csv(const std::vector<EvaluatedScene>& scenes) {
  std::string out =
      "scene,method,detections_source,frame,truth_id,estimate_id,status,distance,center_error,"
      "along_error,center_mahalanobis,height_error,height_sigma,normal_error_deg,yaw_error_deg,"
      "keypoint_error,dimension_error,overlap\n";
  auto value = [](double x) { return std::isnan(x) ? std::string() : fmt::format("{:.6g}", x); };
  for (const EvaluatedScene& scene : scenes) {
    for (const VehicleError& e : scene.metrics.vehicles) {
      out += fmt::format(
          "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", csv_field(scene.scene),
          csv_field(method_label(scene.method, scene.preset, scene.paper_terms)),
          csv_field(scene.detections_source), e.frame, e.truth_id, e.estimate_id,
          to_string(e.status), value(e.distance), value(e.center_error), value(e.along_error),
          value(e.center_mahalanobis), value(e.height_error), value(e.height_sigma),
          value(e.normal_error * kDegrees), value(e.yaw_error * kDegrees), value(e.keypoint_error),
          value(e.dimension_error), value(e.overlap));
    }
  }
  return out;
}

}  // namespace camber
