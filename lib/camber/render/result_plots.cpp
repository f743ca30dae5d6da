#include "camber/render/result_plots.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "camber/core/errors.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_space.h"

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / M_PI;
constexpr std::size_t kManyVehicles = 12;
constexpr int kLongGap = 20;  // frames
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

PlotSeries line(const std::string& name, const Color& color) {
  PlotSeries out;
  out.name = name;
  out.color = color;
  return out;
}

constexpr double kBandSigmas = 1.96;  // on either side of a 95 % band

Plot profile_panel(const std::vector<ProfilePoint>& profile, double ProfilePoint::*value,
                   double ProfilePoint::*sigma, bool slope, const std::string& title,
                   const std::string& unit, const std::string& length_unit, const Color& color) {
  PlotSeries band = line("95 % band", color.with_alpha(0.25)), curve = line("estimate", color);
  band.kind = PlotSeries::Kind::kBand;
  const int decimals = slope ? 2 : 3;
  for (const ProfilePoint& p : profile) {
    const double raw = p.*value;
    const double v = slope ? 100.0 * raw : raw;
    const double margin = kBandSigmas * p.*sigma * (slope ? 100.0 : 1.0);
    std::string value_here =
        format_number(p.station, 1) + " " + length_unit + ": " + format_number(v, decimals);
    if (std::isfinite(margin)) value_here += " ± " + format_number(margin, decimals);
    curve.hover.push_back(title + " at " + value_here + " " + unit);
    curve.x.push_back(p.station);
    curve.y.push_back(v);
    band.x.push_back(p.station);
    band.low.push_back(v - margin);
    band.high.push_back(v + margin);
  }
  Plot plot;
  plot.title = title;
  plot.series = {band, curve};
  return plot;
}

struct MethodErrors {
  std::string name;
  std::vector<double> values;  ///< sorted
  int matched = 0;
};

std::vector<MethodErrors> errors_by_method(const std::vector<EvaluatedScene>& scenes,
                                           PlottedError which) {
  std::vector<MethodErrors> out;
  for (const EvaluatedScene& scene : scenes) {
    const std::string name = scene.method.empty()
                                 ? "estimate"
                                 : method_label(scene.method, scene.preset, scene.paper_terms);
    auto found =
        std::find_if(out.begin(), out.end(), [&](const MethodErrors& m) { return m.name == name; });
    if (found == out.end()) {
      out.push_back({name, {}, 0});
      found = out.end() - 1;
    }
    for (const VehicleError& error : scene.metrics.vehicles) {
      ++found->matched;
      const double value =
          which == PlottedError::kCenter ? error.center_error : std::abs(error.height_error);
      if (error.answered && std::isfinite(value)) found->values.push_back(value);
    }
  }
  for (MethodErrors& method : out) std::sort(method.values.begin(), method.values.end());
  return out;
}

/// The next of 1, 2, 5 times a power of ten that is not less.
double round_up(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= value * (1.0 - 1e-9)) return factor * power;
  }
  return 10.0 * power;
}

/// Depths of the true vehicles, m, by id and frame.
using TrueDepths = std::map<int, std::map<int, double>>;

/// Of all methods: they may have matched different ones.
TrueDepths true_depths(const std::vector<EvaluatedScene>& methods) {
  TrueDepths truth;
  for (const EvaluatedScene& method : methods) {
    for (const VehicleError& error : method.metrics.vehicles) {
      truth[error.truth_id][error.frame] = error.true_depth;
    }
  }
  if (truth.empty()) throw NoAnswerError("depth over time: no detection matches a true vehicle");
  return truth;
}

/// When frames were taken: at their times, or, where these are not known, at their numbers.
class Timeline {
 public:
  /// @throws NoAnswerError if no frame of the truth has a time.
  Timeline(const TrueDepths& truth, const std::map<int, double>& times) : times_(times) {
    for (const auto& [id, depths] : truth) {
      for (const auto& [frame, depth] : depths) {
        if (std::isfinite(when(frame))) instants_.insert(when(frame));
      }
    }
    if (instants_.empty()) throw NoAnswerError("depth over time: no frame has a time");
  }

  /// NaN for a frame without a time.
  double when(int frame) const {
    const auto found = times_.find(frame);
    return times_.empty() ? frame : found == times_.end() ? kNaN : found->second;
  }
  double count() const { return static_cast<double>(instants_.size()); }
  /// Room before the first and after the last.
  double margin() const {
    if (instants_.size() < 2) return 0.5;
    return 0.3 * (*instants_.rbegin() - *instants_.begin()) /
           static_cast<double>(instants_.size() - 1);
  }
  PlotAxis axis() const {
    PlotAxis axis;
    axis.title = times_.empty() ? "frame" : "time, s";
    axis.whole = times_.empty();
    axis.low = *instants_.begin() - margin();
    axis.high = *instants_.rbegin() + margin();
    if (instants_.size() > 10) return axis;
    for (const double t : instants_) {
      axis.names.emplace_back(t, format_number(t, times_.empty() ? 0 : 2));
    }
    return axis;
  }

 private:
  const std::map<int, double>& times_;
  std::set<double> instants_;
};

/// A curve with a gap where the vehicle was out of sight for long.
PlotSeries true_depth_curve(const std::map<int, double>& depths, const Timeline& timeline) {
  PlotSeries curve = line("", kTruthRed);
  int last = depths.begin()->first;
  for (const auto& [frame, depth] : depths) {
    if (frame - last > kLongGap) {
      curve.x.push_back(timeline.when(last));
      curve.y.push_back(kNaN);
    }
    curve.x.push_back(timeline.when(frame));
    curve.y.push_back(depth);
    last = frame;
  }
  return curve;
}

/// One vehicle's estimated depths with bars of 1 sigma.
/// @param shift  along the time axis
PlotSeries estimated_depths(const std::vector<VehicleError>& errors, int id,
                            const Timeline& timeline, double shift) {
  PlotSeries points;
  points.kind = PlotSeries::Kind::kPoints;
  int before = -1;
  for (const VehicleError& error : errors) {
    if (error.truth_id != id) continue;
    if (before >= 0 && error.frame - before > kLongGap) {
      points.x.push_back(timeline.when(error.frame));
      for (auto* values : {&points.y, &points.low, &points.high}) values->push_back(kNaN);
    }
    before = error.frame;
    points.x.push_back(timeline.when(error.frame) + shift);
    points.y.push_back(error.depth);
    const double margin = error.depth_sigma;
    points.low.push_back(std::isfinite(margin) ? error.depth - margin : error.depth);
    points.high.push_back(std::isfinite(margin) ? error.depth + margin : error.depth);
  }
  return points;
}

/// The true curves of all vehicles; the first names them all.
void add_truth(const TrueDepths& truth, const Timeline& timeline, Plot* plot) {
  const bool many = truth.size() > kManyVehicles;
  for (const auto& [id, depths] : truth) {
    PlotSeries curve = true_depth_curve(depths, timeline);
    if (plot->series.empty()) curve.name = many ? "truth, with the vehicles' ids" : "truth";
    curve.label = (many ? "" : "vehicle ") + std::to_string(id);
    plot->series.push_back(curve);
  }
}

/// The estimates of all vehicles. They stand a little beside one another and have marks of their
/// own, which the truth's last point repeats.
void add_estimates(const EvaluatedScene& method, const Color& color, const TrueDepths& truth,
                   const Timeline& timeline, Plot* plot) {
  const double size = std::clamp(60.0 / timeline.count(), 0.35, 1.0);
  const auto vehicles = static_cast<double>(truth.size());
  std::vector<PlotSeries> marks;
  int index = 0;
  for (const auto& [id, depths] : truth) {
    const double shift = 0.16 * timeline.margin() * (index - 0.5 * (vehicles - 1.0)) /
                         std::max(1.0, 0.25 * vehicles);
    PlotSeries points = estimated_depths(method.metrics.vehicles, id, timeline, shift);
    points.color = color;
    points.marker_size = size;
    PlotSeries last = line("", kTruthRed);
    last.kind = PlotSeries::Kind::kPoints;
    last.marker_size = std::max(size, truth.size() > kManyVehicles ? 0.5 : 1.0);
    last.x = {timeline.when(depths.rbegin()->first)};
    last.y = {depths.rbegin()->second};
    points.marker = last.marker = index++;
    PlotSeries path = line("", color.with_alpha(0.6));
    path.x = points.x;
    path.y = points.y;
    path.thickness = 1.0;
    marks.insert(marks.end(), {path, points, last});
  }
  const std::string name = method.method.empty()
                               ? "estimate"
                               : method_label(method.method, method.preset, method.paper_terms);
  marks[1].name = name + ", bars: ± 1 sigma";
  const auto beyond =
      std::count_if(method.metrics.vehicles.begin(), method.metrics.vehicles.end(),
                    [&](const VehicleError& error) { return error.depth > *plot->y.high; });
  if (beyond > 0) marks[1].name += ", " + std::to_string(beyond) + " off the plot";
  plot->series.insert(plot->series.end(), marks.begin(), marks.end());
}

}  // namespace

PlotSheet profile_plots(const std::vector<ProfilePoint>& profile, bool metric,
                        const std::string& title) {
  const std::string unit = metric ? "m" : "units";
  const bool known = std::any_of(profile.begin(), profile.end(),
                                 [](const ProfilePoint& p) { return std::isfinite(p.height); });
  if (!known) throw NoAnswerError("profile: no station of the line is covered by the surface");
  PlotSheet sheet;
  sheet.title = title;
  Plot height = profile_panel(profile, &ProfilePoint::height, &ProfilePoint::sigma_height, false,
                              "Height", unit, unit, plot_color(0));
  height.y.title = "height, " + unit;
  sheet.panels.push_back(height);
  const auto add = [&](double ProfilePoint::*value, double ProfilePoint::*sigma,
                       const std::string& name, const std::string& sense, int color) {
    const bool any = std::any_of(profile.begin(), profile.end(),
                                 [&](const ProfilePoint& p) { return std::isfinite(p.*value); });
    if (!any) return;
    sheet.panels.push_back(
        profile_panel(profile, value, sigma, true, name, "%", unit, plot_color(color)));
    sheet.panels.back().title += sense;
    sheet.panels.back().y.title = name + ", %";
    sheet.panels.back().y.title[0] = static_cast<char>(std::tolower(name[0]));
  };
  add(&ProfilePoint::grade, &ProfilePoint::sigma_grade, "Grade", " (positive: climbs)", 2);
  add(&ProfilePoint::cross_slope, &ProfilePoint::sigma_cross_slope, "Cross slope",
      " (bank; positive: left side up)", 3);
  for (Plot& panel : sheet.panels) {
    panel.x.title = "distance along the line, " + unit;
    panel.x.low = profile.front().station;
    panel.x.high = std::max(profile.back().station, profile.front().station + 1e-6);
  }
  return sheet;
}

PlotSheet cross_section_profile_plots(const CloudProfile& profile, bool metric,
                                      const std::string& title) {
  const std::vector<ProfilePoint> points(profile.stations.begin(), profile.stations.end());
  PlotSheet sheet = profile_plots(points, metric, title);
  const auto add_side = [&](double CrossSection::*value, double CrossSection::*sigma,
                            const std::string& name, int color) {
    std::vector<ProfilePoint> side = points;
    bool any = false;
    for (std::size_t k = 0; k < side.size(); ++k) {
      side[k].cross_slope = profile.stations[k].*value;
      side[k].sigma_cross_slope = profile.stations[k].*sigma;
      any = any || std::isfinite(side[k].cross_slope);
    }
    if (!any) return;
    Plot panel = profile_panel(side, &ProfilePoint::cross_slope, &ProfilePoint::sigma_cross_slope,
                               true, "Cross slope " + name + " of the crest", "%",
                               metric ? "m" : "units", plot_color(color));
    panel.title += " (positive: left side up)";
    panel.y.title = "cross slope, %";
    panel.x = sheet.panels.front().x;
    sheet.panels.push_back(std::move(panel));
  };
  add_side(&CrossSection::cross_slope_left, &CrossSection::sigma_cross_slope_left, "left", 3);
  add_side(&CrossSection::cross_slope_right, &CrossSection::sigma_cross_slope_right, "right", 4);
  return sheet;
}

PlotSheet cross_section_plots(const CloudProfile& profile, bool metric, const std::string& title) {
  constexpr std::size_t kMost = 12;
  std::vector<const CrossSection*> sections;
  for (const CrossSection& at : profile.stations) {
    if (at.offsets.size() > 1 && std::isfinite(at.height)) sections.push_back(&at);
  }
  if (sections.empty()) throw NoAnswerError("profile: no station of the line has a cross-section");
  const std::string unit = metric ? "m" : "units";
  PlotSheet sheet;
  sheet.title = title;
  const std::size_t count = std::min(kMost, sections.size());
  for (std::size_t i = 0; i < count; ++i) {
    const CrossSection& at = *sections[count > 1 ? i * (sections.size() - 1) / (count - 1) : 0];
    PlotSeries ground = line("ground", plot_color(0)), slope = line("cross slope", plot_color(3));
    slope.dashed = true;
    double mean = 0.0, middle = 0.0;
    for (std::size_t k = 0; k < at.offsets.size(); ++k) {
      ground.x.push_back(at.offsets[k]);
      ground.y.push_back(at.heights[k] - at.height);
      mean += ground.y.back() / static_cast<double>(at.offsets.size());
      middle += at.offsets[k] / static_cast<double>(at.offsets.size());
    }
    for (const double v : {at.offsets.front(), at.offsets.back()}) {
      slope.x.push_back(v);
      slope.y.push_back(mean + at.cross_slope * (v - middle));
    }
    Plot panel;
    panel.title = "Station " + format_number(at.station, 1) + " " + unit + ": cross slope " +
                  format_number(100.0 * at.cross_slope, 2) + " ± " +
                  format_number(100.0 * kBandSigmas * at.sigma_cross_slope, 2) + " %, height " +
                  format_number(at.height, 3) + " " + unit;
    panel.series = {ground, slope};
    panel.x.title = "to the left of the line, " + unit;
    panel.y.title = "height, " + unit;
    sheet.panels.push_back(std::move(panel));
  }
  return sheet;
}

PlotSheet timing_plots(const Timings& timings, const std::string& title) {
  if (timings.stages().empty()) throw NoAnswerError("timings: no stage is recorded");
  PlotSheet sheet;
  sheet.title = title;
  Plot plot;
  PlotSeries bars = line("", plot_color(0));
  bars.kind = PlotSeries::Kind::kBoxes;
  double row = 0.0, total = 0.0, longest = 0.0;
  for (const auto& [stage, ms] : timings.stages()) {
    bars.x.push_back(0.0);
    bars.right.push_back(ms);
    bars.low.push_back(row - 0.36);
    bars.high.push_back(row + 0.36);
    plot.y.names.emplace_back(row, stage);
    plot.notes.push_back({ms, row, " " + format_number(ms, ms < 9.95 ? 1 : 0) + " ms"});
    row -= 1.0;
    total += ms;
    longest = std::max(longest, ms);
  }
  plot.series = {bars};
  plot.x.title = "wall-clock time, ms (sum " + format_number(total, total < 99.5 ? 1 : 0) + " ms)";
  plot.x.low = 0.0;
  plot.x.high = std::max(1e-3, 1.16 * longest);  // room for the number behind the bar
  plot.y.low = row + 0.4;
  plot.y.high = 0.6;
  sheet.panels.push_back(plot);
  return sheet;
}

PlotSheet evidence_plots(const RunDocument& run) {
  Plot plot;
  PlotSeries intervals = line("one standard deviation", plot_color(0).with_alpha(0.45));
  PlotSeries values = line("", plot_color(0));
  intervals.kind = PlotSeries::Kind::kBoxes;
  values.kind = PlotSeries::Kind::kPoints;
  double row = 0.0;
  const auto add = [&](const std::string& name, double log_scale, double sigma) {
    const auto per_cent = [](double log_ratio) { return 100.0 * std::expm1(log_ratio); };
    intervals.x.push_back(per_cent(log_scale - sigma));
    intervals.right.push_back(per_cent(log_scale + sigma));
    intervals.low.push_back(row - 0.3);
    intervals.high.push_back(row + 0.3);
    values.x.push_back(per_cent(log_scale));
    values.y.push_back(row);
    plot.y.names.emplace_back(row, name);
    row -= 1.0;
  };
  constexpr double kHardly = 1.0;  // of the logarithm: what knows less would hide the others
  const auto evidence = run.extra->find("evidence");
  if (evidence != run.extra->end() && evidence->is_array()) {
    for (const nlohmann::json& e : *evidence) {
      if (!e.is_object()) continue;
      const auto number = [&](const char* key) {
        const auto v = e.find(key);
        return v != e.end() && v->is_number() ? v->get<double>() : kNaN;
      };
      const auto text = [&](const char* key) {
        const auto v = e.find(key);
        return v != e.end() && v->is_string() ? v->get<std::string>() : std::string();
      };
      const double log_scale = number("log_scale"), sigma = number("sigma");
      if (text("cause") == "focal_length" || !(sigma < kHardly) ||
          !(std::abs(log_scale) < kHardly)) {
        continue;
      }
      std::string name = text("name");
      std::replace(name.begin(), name.end(), '_', ' ');
      add(name, log_scale, sigma);
    }
  }
  if (values.x.empty()) throw NoAnswerError("evidence: no source measures the scale");
  add("the result", 0.0, std::min(run.scale_sigma, kHardly));
  plot.series = {intervals, values};
  plot.x.title = "scale against the result's, %";
  plot.y.low = row + 0.4;
  plot.y.high = 0.6;
  PlotSheet sheet;
  sheet.panels.push_back(plot);
  return sheet;
}

PlotSheet error_plots(const std::vector<EvaluatedScene>& scenes, PlottedError which) {
  constexpr int kBars = 20;
  const std::vector<MethodErrors> methods = errors_by_method(scenes, which);
  const bool center = which == PlottedError::kCenter;
  const std::string what = center ? "3D error of the vehicles' centres"
                                  : "height error of the ground under the vehicles";
  double best = std::numeric_limits<double>::infinity(), least = best, largest = 0.0;
  for (const MethodErrors& method : methods) {
    if (method.values.empty()) continue;
    const std::size_t at = (method.values.size() * 9) / 10;
    best = std::min(best, method.values[std::min(at, method.values.size() - 1)]);
    least = std::min(least, method.values.front());
    largest = std::max(largest, method.values.back());
  }
  if (!std::isfinite(best)) throw NoAnswerError("error plots: no matched vehicle has an answer");
  PlotSheet sheet;
  sheet.title = center ? "Localisation error" : "Ground height error";
  Plot bars, curve;
  const double bar = round_up(std::max(1e-3, 1.8 * best / kBars));
  bars.title = "Histogram";
  bars.x.title = what + ", m (last bar: all beyond)";
  bars.y.title = "share of vehicles, %";
  bars.x.low = 0.0;
  bars.x.high = bar * kBars;
  bars.y.low = 0.0;
  curve.title = "Vehicles within an error";
  curve.x.title = what + ", m";
  curve.y.title = "share of vehicles, %";
  curve.x.logarithmic = true;
  curve.x.low = std::pow(10.0, std::floor(std::log10(std::clamp(least, 0.001, 0.1))));
  curve.x.high = round_up(std::max(1.05 * largest, 1e-2));
  curve.y.low = 0.0;
  curve.y.high = 100.0;
  for (std::size_t k = 0; k < methods.size(); ++k) {
    const MethodErrors& method = methods[k];
    const ErrorSummary summary = summarise(method.values);
    std::string name = method.name + ": " + std::to_string(method.matched) + " vehicles";
    if (summary.count > 0) {
      name += ", median " + format_number(summary.median, center ? 2 : 3) + " m, mean " +
              format_number(summary.mean, center ? 2 : 3) + " m";
    }
    if (summary.count < method.matched) {
      name += ", " + std::to_string(method.matched - summary.count) + " without an answer";
    }
    PlotSeries boxes = line(name, plot_color(static_cast<int>(k)));
    boxes.kind = PlotSeries::Kind::kBoxes;
    std::vector<int> counts(kBars, 0);
    for (const double v : method.values) {
      ++counts[static_cast<std::size_t>(std::min(kBars - 1.0, std::floor(v / bar)))];
    }
    const double slot = 0.84 * bar / static_cast<double>(methods.size());
    for (int i = 0; i < kBars; ++i) {
      const double left = (i + 0.08) * bar + slot * static_cast<double>(k);
      boxes.x.push_back(left);
      boxes.right.push_back(left + slot);
      boxes.low.push_back(0.0);
      boxes.high.push_back(100.0 * counts[static_cast<std::size_t>(i)] /
                           std::max(1, method.matched));
    }
    bars.series.push_back(boxes);
    PlotSeries steps = line(method.name, plot_color(static_cast<int>(k)));
    steps.thickness = 2.6;
    const auto add = [&](double x, std::size_t within) {
      steps.x.push_back(std::max(x, *curve.x.low));
      steps.y.push_back(100.0 * static_cast<double>(within) / method.matched);
    };
    if (!method.values.empty()) add(*curve.x.low, 0);
    for (std::size_t i = 0; i < method.values.size(); ++i) {
      add(method.values[i], i);
      add(method.values[i], i + 1);
    }
    if (!method.values.empty()) add(*curve.x.high, method.values.size());
    curve.series.push_back(steps);
  }
  sheet.panels = {bars, curve};
  return sheet;
}

PlotSheet depth_plots(const std::vector<EvaluatedScene>& methods,
                      const std::map<int, double>& times) {
  const TrueDepths truth = true_depths(methods);
  const Timeline timeline(truth, times);
  double farthest = 0.0;
  for (const auto& [id, depths] : truth) {
    for (const auto& [frame, depth] : depths) farthest = std::max(farthest, depth);
  }
  PlotSheet sheet;
  sheet.title = "Depth over time: " + methods.front().scene;
  for (std::size_t k = 0; k < methods.size(); ++k) {
    Plot plot;
    plot.x = timeline.axis();
    plot.y.title = "depth of the centre, m";
    plot.y.low = 0.0;
    plot.y.high = 1.25 * farthest;
    add_truth(truth, timeline, &plot);
    add_estimates(methods[k], plot_color(static_cast<int>(k)), truth, timeline, &plot);
    sheet.panels.push_back(plot);
  }
  return sheet;
}

}  // namespace camber
