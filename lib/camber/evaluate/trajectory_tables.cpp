#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/evaluate/detail/text_table.h"
#include "camber/evaluate/trajectory_errors.h"

namespace camber {
namespace {

using detail::cell;
using nlohmann::json;

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

std::string percent(double share, int digits) { return cell(100.0 * share, digits); }

/// A relative error (of its logarithm) in per cent, signed.
std::string relative(double log_error) {
  return std::isfinite(log_error) ? fmt::format("{:+.2f} %", 100.0 * std::expm1(log_error))
                                  : std::string("-");
}

std::vector<std::string> sub_path_cells(const std::string& name, const SubPathErrors& e) {
  return {name, std::to_string(e.count), percent(e.translation, 3),
          cell(100.0 * e.rotation * kDegrees, 4), std::to_string(e.unanswered)};
}

std::vector<std::vector<std::string>> odometry_lines(const TrajectoryErrors& e) {
  std::vector<std::vector<std::string>> lines{
      {"sub-paths", "n", "translation %", "deg / 100 m", "no pose"}};
  for (const OdometryErrors* one : {&e.every_nth, &e.every_frame}) {
    const std::string from =
        one->every == 1 ? "every frame" : fmt::format("every {}th frame", one->every);
    std::string lengths = "100 m or longer";
    if (!one->by_length.empty()) {
      const double least = one->by_length.front().length, most = one->by_length.back().length;
      lengths =
          least < most ? fmt::format("{:g} to {:g} m", least, most) : fmt::format("{:g} m", least);
    }
    lines.push_back(sub_path_cells(lengths + ", " + from, one->all));
    if (one->half) {
      lines.push_back(sub_path_cells(
          fmt::format("half the drive ({:.1f} m), {}", one->half->length, from), *one->half));
    }
  }
  return lines;
}

std::vector<std::vector<std::string>> alignment_lines(const TrajectoryErrors& e) {
  std::vector<std::vector<std::string>> lines{{"alignment", "scale", "ATE rmse m", "mean", "median",
                                               "max", "RPE mm a step", "RPE deg a step"}};
  const std::pair<const char*, const AlignedErrors*> rows[] = {
      {"first frame", &e.unaligned}, {"rigid", &e.rigid}, {"with scale", &e.with_scale}};
  for (const auto& [name, a] : rows) {
    lines.push_back({name, cell(a->scale, 4), cell(a->ate_rmse, 3), cell(a->ate_mean, 3),
                     cell(a->ate_median, 3), cell(a->ate_max, 3),
                     cell(1000.0 * a->rpe_translation, 2), cell(kDegrees * a->rpe_rotation, 4)});
  }
  return lines;
}

std::string window_line(const WindowErrors& w) {
  if (w.windows.empty()) {
    return fmt::format("windows: none ({} without a pose at an end, {} stationary)", w.unanswered,
                       w.stationary);
  }
  std::string out = fmt::format(
      "windows: {}, scale error mean {}, standard deviation {} %, 95 % within {} %, "
      "{} % within 2 %",
      w.windows.size(), relative(w.mean), percent(w.deviation, 2), percent(w.p95, 2),
      percent(w.close, 0));
  if (w.with_sigma > 0) {
    out += fmt::format("; {} % inside 2 sigma, spread over their own sigma {}",
                       percent(w.within_2_sigma, 0), cell(w.own_spread, 2));
  }
  if (w.unanswered > 0) out += fmt::format("; {} without a pose at an end", w.unanswered);
  if (w.stationary > 0) out += fmt::format("; {} stationary", w.stationary);
  return out;
}

json sub_path_json(const SubPathErrors& e) {
  json out = {{"count", e.count},
              {"unanswered", e.unanswered},
              {"translation_percent", number(100.0 * e.translation)},
              {"rotation_deg_per_100m", number(100.0 * e.rotation * kDegrees)}};
  if (e.length > 0.0) out["length"] = e.length;
  return out;
}

json odometry_json(const OdometryErrors& e) {
  json by_length = json::array();
  for (const SubPathErrors& one : e.by_length) by_length.push_back(sub_path_json(one));
  json out = sub_path_json(e.all);
  out["every"] = e.every;
  out["by_length"] = std::move(by_length);
  out["half"] = e.half ? sub_path_json(*e.half) : json(nullptr);
  return out;
}

json aligned_json(const AlignedErrors& e) {
  return {{"scale", number(e.scale)},
          {"ate",
           {{"rmse", number(e.ate_rmse)},
            {"mean", number(e.ate_mean)},
            {"median", number(e.ate_median)},
            {"max", number(e.ate_max)}}},
          {"rpe_translation_rmse", number(e.rpe_translation)},
          {"rpe_rotation_rmse_deg", number(kDegrees * e.rpe_rotation)}};
}

}  // namespace

std::string trajectory_text(const std::vector<EvaluatedTrajectory>& trajectories, bool markdown) {
  std::string out;
  for (const EvaluatedTrajectory& t : trajectories) {
    const TrajectoryErrors& e = t.errors;
    if (markdown && !out.empty()) out += "\n";
    out += fmt::format("{} ({}): {} of {} frames with a pose ({} %)\n", t.estimate, t.method,
                       e.posed, e.frames, percent(static_cast<double>(e.posed) / e.frames, 1));
    const char* end = markdown ? "\n\n" : "\n";
    if (markdown) out += "\n";
    if (!t.metric) {
      const std::string mark = "MARKED: the trajectory is up to scale, its errors are no metres";
      out += (markdown ? "**" + mark + "**" : mark) + end;
    }
    out += fmt::format("{}length {:.2f} m of {:.2f} m: {}", markdown ? "" : "  ", e.length,
                       e.true_length, relative(e.length_error));
    if (std::isfinite(e.length_sigma)) {
      out += fmt::format(", {} of the stated {} %",
                         cell(e.length_error / e.length_sigma, 2) + " sigma",
                         percent(e.length_sigma, 2));
    }
    out += end;
    out += (markdown ? "" : "  ") + window_line(e.windows) + end;
    out += detail::table_text(odometry_lines(e), markdown);
    if (markdown) out += "\n";
    out += detail::table_text(alignment_lines(e), markdown);
  }
  return out;
}

json to_json(const EvaluatedTrajectory& t) {
  const TrajectoryErrors& e = t.errors;
  json windows = json::array();
  for (const WindowError& w : e.windows.windows) {
    windows.push_back({{"first", w.first},
                       {"last", w.last},
                       {"length", number(w.length)},
                       {"true_length", number(w.true_length)},
                       {"log_error", number(w.error)},
                       {"sigma", number(w.sigma)},
                       {"error_sigma", number(w.error / w.sigma)}});
  }
  return {{"truth", t.truth},
          {"estimate", t.estimate},
          {"method", t.method},
          {"metric", t.metric},
          {"frames_taken", t.frames_taken},
          {"frames", e.frames},
          {"frames_with_pose", e.posed},
          {"share_with_pose", number(static_cast<double>(e.posed) / e.frames)},
          {"length", number(e.length)},
          {"true_length", number(e.true_length)},
          {"length_log_error", number(e.length_error)},
          {"length_sigma", number(e.length_sigma)},
          {"length_error_sigma", number(e.length_error / e.length_sigma)},
          {"kitti_every_10th", odometry_json(e.every_nth)},
          {"kitti_every_frame", odometry_json(e.every_frame)},
          {"windows",
           {{"count", e.windows.windows.size()},
            {"unanswered", e.windows.unanswered},
            {"stationary", e.windows.stationary},
            {"mean_log_error", number(e.windows.mean)},
            {"std_log_error", number(e.windows.deviation)},
            {"p95_abs_log_error", number(e.windows.p95)},
            {"within_2_percent", number(e.windows.close)},
            {"with_sigma", e.windows.with_sigma},
            {"within_2_sigma", number(e.windows.within_2_sigma)},
            {"own_spread", number(e.windows.own_spread)},
            {"windows", std::move(windows)}}},
          {"unaligned", aligned_json(e.unaligned)},
          {"rigid", aligned_json(e.rigid)},
          {"with_scale", aligned_json(e.with_scale)}};
}

}  // namespace camber
