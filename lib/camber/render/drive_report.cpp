#include "camber/render/drive_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/render/base64.h"
#include "camber/render/color_map.h"
#include "camber/render/detail/report_html.h"
#include "camber/render/drive_plots.h"
#include "camber/render/drive_report_script.h"
#include "camber/render/report_viewer.h"
#include "camber/scene/json_reader.h"

namespace camber {
namespace {

using detail::escape;
using detail::flatten;
using detail::folded;
using detail::number;
using detail::page_head;
using detail::plot_figure;
using detail::row;
using detail::status_cell;
using detail::table;
using detail::with_margin;
using nlohmann::json;

constexpr double kDegrees = 180.0 / M_PI;
constexpr std::size_t kLongTable = 30;  // rows

/// A number of few digits, or null.
json rounded(double value, double step) { return number_json(std::round(value / step) * step); }

std::string frame_link(int id) { return fmt::format("<a href=\"#f{0}\">{0}</a>", id); }

std::string length_unit(const DriveContent& content) {
  return content.drive->metric ? "m" : "units";
}

std::string summary_section(const DriveContent& content) {
  const DriveDocument& drive = *content.drive;
  const std::string unit = length_unit(content);
  const auto posed = std::count_if(drive.frames.begin(), drive.frames.end(),
                                   [](const DriveFrame& f) { return !!f.world_from_camera; });
  std::string rows =
      row({"length", with_margin(drive.length, drive.length_sigma, 2) + " " + unit}) +
      row({"of it shared by all windows (height, lens)",
           number(100.0 * drive.common_sigma, 2) + " %"}) +
      row({"frames", fmt::format("{}, {} with a pose", drive.frames.size(), posed)});
  const DriveFrame& first = drive.frames.front();
  const DriveFrame& last = drive.frames.back();
  if (std::isfinite(last.time_s - first.time_s)) {
    rows += row({"time", number(last.time_s - first.time_s, 2) + " s"});
  }
  rows +=
      row({"camera above the road",
           with_margin(drive.height.value, drive.height.sigma, 3) + " " + unit}) +
      row({"its pitch against the road (positive: looks up)",
           with_margin(drive.pitch.value * kDegrees, drive.pitch.sigma * kDegrees, 2) + " &deg;"}) +
      row({"its roll (positive: right side down)",
           with_margin(drive.roll.value * kDegrees, drive.roll.sigma * kDegrees, 2) + " &deg;"}) +
      row({"road", fmt::format("{} cells, {} patches", content.strip->cells.size(),
                               content.surface->patches.size())}) +
      row({"vehicles", fmt::format("{} tracks", content.tracks.size())});
  std::string note = "&plusmn; is one standard deviation; bands in plots are 95 %. ";
  if (!drive.metric) {
    note += "No source of metres is known: the drive is up to scale, in units of its own. ";
  }
  note += content.surface->level == RoadSurface::Level::kGravity
              ? "Grades and cross slopes are against gravity."
              : "Grades and cross slopes are against the mean level of the drive: no frame knows "
                "gravity.";
  return table({"what", "value"}, rows) + "<p class=n>" + note + "</p>\n";
}

/// The picture of a frame with its slider.
std::string frame_section(const DriveReport& report) {
  const DriveContent& content = report.content;
  std::string out = "<h2 id=frame>Frame by frame</h2>\n";
  if (!report.pictures.empty()) {
    out += "<img id=shot alt=\"the frame with road and vehicles\" src=\"data:image/jpeg;base64," +
           base64(report.pictures.begin()->second) + "\">\n";
  }
  out += fmt::format(
      "<p><input id=at type=range min=0 max={} value=0 style=\"width:100%\" "
      "aria-label=\"frame of the drive\"></p><output id=now class=said></output>\n",
      content.drive->frames.size() - 1);
  out +=
      "<p class=n>Click the map or a plot, or a frame's number in a table, to come to its frame.";
  if (!report.pictures.empty() && report.pictures.size() < content.drive->frames.size()) {
    out += fmt::format(" Of {} frames {} have their picture here: the nearest is shown.",
                       content.drive->frames.size(), report.pictures.size());
  }
  if (!report.film.empty()) {
    out += " All of them: <a href=\"" + escape(report.film) + "\">" + escape(report.film) + "</a>.";
  }
  return out + "</p>\n";
}

std::string plot_sections(const DriveContent& content, const std::vector<ProfilePoint>& profile) {
  std::string out;
  try {
    const PlotSheet map = drive_map(content, profile);
    out += "<h2>Map</h2>\n<div id=map>" + plot_figure(map, map_height(map, 760)) + "</div>\n";
  } catch (const NoAnswerError&) {
    return out;
  }
  try {
    out += "<h2>Along the driven line</h2>\n<div id=profile>" +
           plot_figure(drive_profile_plots(content, profile), 190) + "</div>\n";
  } catch (const NoAnswerError&) {
    return out;
  }
  return out +
         "<p class=n>The band of the height is that of the camera's path against the start "
         "and of the road under it, without the common error of the scale.</p>\n";
}

std::string window_section(const DriveContent& content) {
  const DriveDocument& drive = *content.drive;
  if (drive.windows.empty()) return {};
  std::string rows;
  for (const DriveWindow& w : drive.windows) {
    rows += row({frame_link(w.first), frame_link(w.last), with_margin(w.length, w.length_sigma, 2),
                 number(100.0 * w.length_sigma / w.length, 2)});
  }
  return "<h2>Lengths of windows</h2>\n" +
         folded(table({"first frame", "last", "length (" + length_unit(content) + ")", "%"}, rows),
                fmt::format("{} windows of 50 steps", drive.windows.size()),
                drive.windows.size() > kLongTable);
}

/// Frames that are not ok, neighbours with the same reason as one row.
std::string weak_section(const DriveReport& report) {
  const std::vector<DriveFrame>& frames = report.content.drive->frames;
  std::string rows;
  std::size_t count = 0, groups = 0;
  for (std::size_t i = 0; i < frames.size();) {
    std::size_t end = i + 1;
    while (end < frames.size() && frames[end].status == frames[i].status &&
           frames[end].reason == frames[i].reason) {
      ++end;
    }
    if (frames[i].status != Status::kOk) {
      ++groups;
      count += end - i;
      const std::string span =
          end - i == 1 ? frame_link(frames[i].id)
                       : frame_link(frames[i].id) + " to " + frame_link(frames[end - 1].id);
      rows += row({span, std::to_string(end - i), status_cell(frames[i].status, ""),
                   "<td class=w>" + escape(frames[i].reason) + "</td>"});
    }
    i = end;
  }
  std::string out = "<h2>What is weak</h2>\n";
  if (count == 0) {
    out += "<p>All frames are ok.</p>\n";
  } else {
    out += folded(table({"frames", "count", "status", "reason"}, rows),
                  fmt::format("{} of {} frames", count, frames.size()), groups > kLongTable);
  }
  // Windows whose scale the others outvoted.
  std::string outvoted;
  std::size_t windows = 0;
  const auto found = report.run->find("windows");
  if (found != report.run->end() && found->is_array()) {
    for (const json& w : *found) {
      constexpr double kOutvoted = 0.5;
      if (!w.contains("weight") || !(w.at("weight").get<double>() < kOutvoted)) continue;
      ++windows;
      outvoted += row({frame_link(w.at("reference")), number(w.at("residual_sigma"), 1),
                       number(w.at("weight"), 2)});
    }
    if (windows > 0) {
      out += folded(table({"window about frame", "off (sigmas)", "weight"}, outvoted),
                    fmt::format("{} of {} windows have another scale than their neighbours and are "
                                "outvoted",
                                windows, found->size()),
                    true);
    }
  }
  for (const json& warning : report.run->value("warnings", json::array())) {
    out += "<p>" + escape(warning.value("text", "")) + "</p>\n";
  }
  return out;
}

std::string track_section(const DriveContent& content) {
  if (content.tracks.empty()) return {};
  std::string rows;
  for (const DriveTrackLine& track : content.tracks) {
    if (track.places.empty()) continue;
    const Color c = categorical(track.id);
    double path = 0.0;
    for (std::size_t i = 1; i < track.places.size(); ++i) {
      path += (track.places[i].in_world - track.places[i - 1].in_world).norm();
    }
    const Dimensions& d = track.dimensions;
    rows += row({fmt::format("<i class=k style=\"background:#{:02x}{:02x}{:02x}\"></i>", c.red,
                             c.green, c.blue) +
                     escape(track.vehicle_class) + " " + std::to_string(track.id),
                 track.parked ? "parked" : "moving", std::to_string(track.places.size()),
                 frame_link(track.places.front().frame), frame_link(track.places.back().frame),
                 track.parked ? "&ndash;" : number(path, 1),
                 number(d.length, 2) + " &times; " + number(d.width, 2) + " &times; " +
                     number(d.height, 2)});
  }
  const std::string unit = length_unit(content);
  return "<h2>Vehicles</h2>\n" +
         folded(table({"vehicle", "motion", "frames", "first", "last", "path (" + unit + ")",
                       "l &times; w &times; h (" + unit + ")"},
                      rows),
                fmt::format("{} tracks", content.tracks.size()),
                content.tracks.size() > kLongTable);
}

std::string run_section(const json& run) {
  std::string facts = row({"version", "Camber " + escape(kVersion)});
  for (const char* key : {"seed", "scene", "options"}) {
    const auto found = run.find(key);
    if (found != run.end()) flatten(*found, key, &facts);
  }
  return "<h2>Run</h2>\n" + table({"what", "value"}, facts) +
         "<p class=n>run.json has the command and the time of each stage.</p>\n";
}

/// What the script works on.
std::string data_section(const DriveReport& report) {
  const DriveContent& content = report.content;
  const std::vector<double> stations = frame_stations(content);
  json frames = json::array();
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const DriveFrame& f = content.drive->frames[i];
    Eigen::Vector3d place = Eigen::Vector3d::Constant(std::nan(""));
    if (f.world_from_camera) {
      place = content.strip->strip_from_world * f.world_from_camera->translation();
    }
    frames.push_back(
        {f.id, rounded(f.time_s, 1e-3), rounded(stations[i], 1e-2), rounded(place.x(), 1e-2),
         rounded(place.y(), 1e-2), rounded(f.s.value, 1e-2), rounded(f.speed.value, 1e-2),
         rounded(f.speed.sigma, 1e-2), rounded(100.0 * std::tan(f.grade.value), 1e-2),
         rounded(100.0 * f.grade.sigma, 1e-2), rounded(100.0 * std::tan(f.bank.value), 1e-2),
         rounded(100.0 * f.bank.sigma, 1e-2), rounded(f.height.value, 1e-3),
         rounded(f.height.sigma, 1e-3), to_string(f.status), f.reason});
  }
  json pictures = json::object();
  for (const auto& [index, jpeg] : report.pictures) {
    pictures[std::to_string(index)] = base64(jpeg);
  }
  const json data = {{"unit", length_unit(content)}, {"frames", frames}, {"pictures", pictures}};
  std::string text = data.dump(-1, ' ', false, json::error_handler_t::replace);
  for (std::size_t at = 0; (at = text.find("</", at)) != std::string::npos; at += 3) {
    text.insert(at + 1, "\\");  // nothing in it ends the script's element
  }
  return "<script type=\"application/json\" id=drive>" + text + "</script>\n<script>" +
         kDriveReportScript + "</script>\n";
}

}  // namespace

std::string make_drive_report(const DriveReport& report) {
  const DriveContent& content = report.content;
  const std::vector<ProfilePoint> profile = drive_profile(content);
  std::string out = page_head(content.title.empty() ? "Drive" : content.title);
  out += summary_section(content);
  out += frame_section(report);
  out += plot_sections(content, profile);
  out += window_section(content);
  out += weak_section(report);
  out += track_section(content);
  out += run_section(*report.run);
  out += data_section(report);
  out += std::string("<script>") + kReportAnswers + "</script>\n";
  return out + "</body></html>\n";
}

}  // namespace camber
