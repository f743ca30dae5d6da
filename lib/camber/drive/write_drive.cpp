#include "camber/drive/write_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <ostream>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;

json matrix_json(const SE3& pose) {
  const Eigen::Matrix4d m = pose.matrix();
  json out = json::array();
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) out.push_back(m(r, c));
  }
  return out;
}

/// One stretch as a cloud in the strip's frame.
RoadCloud stretch_cloud(const std::vector<const StripCell*>& cells, bool metric) {
  RoadCloud out;
  out.frame = CloudFrame::kZUp;
  out.metric = metric;
  if (cells.empty()) return out;
  const Eigen::Vector3d first = cells.front()->point;
  out.origin = {std::round(first.x()), std::round(first.y()), std::round(first.z())};
  std::vector<float>& s = out.scalars["s"];
  std::vector<float>& lateral = out.scalars["lateral"];
  std::vector<float>& sigma = out.scalars["sigma"];
  std::vector<int>& label = out.labels["label"];
  for (const StripCell* cell : cells) {
    out.points.push_back((cell->point - out.origin).cast<float>());
    out.colors.push_back(cell->color);
    s.push_back(static_cast<float>(cell->s));
    lateral.push_back(static_cast<float>(cell->lateral));
    sigma.push_back(static_cast<float>(cell->sigma));
    label.push_back(cell->label);
  }
  return out;
}

void write_strip(const DriveResult& result, const RoadStripOptions& options,
                 const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw OutputError(folder.string(), error.message());
  std::map<int, std::vector<const StripCell*>> stretches;
  for (const StripCell& cell : result.strip.cells) {
    stretches[static_cast<int>(std::floor(cell.s / options.stretch))].push_back(&cell);
  }
  json list = json::array();
  int number = 0;
  for (const auto& [index, cells] : stretches) {
    const std::string name = fmt::format("{:06d}.ply", number++);
    write_cloud(stretch_cloud(cells, result.trajectory.metric), folder / name);
    list.push_back({{"file", name},
                    {"from_s", index * options.stretch},
                    {"to_s", (index + 1) * options.stretch},
                    {"cells", cells.size()}});
  }
  json line = json::array();
  for (const DrivenPoint& p : result.strip.line.points()) {
    line.push_back({p.s, p.foot.x(), p.foot.y(), p.foot.z()});
  }
  write_json({{"format", "camber-strip"},
              {"version", 1},
              {"metric", result.trajectory.metric},
              {"level", result.level_by_gravity ? "gravity" : "camera"},
              {"strip_from_world", matrix_json(result.strip.strip_from_world)},
              {"cell", options.cell},
              {"length", result.strip.line.length()},
              {"driven_line_s_xyz", std::move(line)},
              {"stretches", std::move(list)}},
             folder / "index.json");
}

}  // namespace

json to_json(const DriveTracks& tracks) {
  json out = json::array();
  for (const DriveTrack& track : tracks.tracks) {
    json views = json::array();
    for (const DriveTrack::View& view : track.views) {
      views.push_back({{"frame", view.frame},
                       {"id", view.detection},
                       {"time_s", view.time_s},
                       {"world_from_vehicle", matrix_json(view.world_from_vehicle)}});
    }
    const Dimensions& d = track.dimensions;
    out.push_back({{"id", track.id},
                   {"class", track.vehicle_class},
                   {"motion", track.parked ? "parked" : "moving"},
                   {"status", track.rejected.empty() ? "ok" : "rejected"},
                   {"reason", track.rejected},
                   {"dimensions", {{"length", d.length}, {"width", d.width}, {"height", d.height}}},
                   {"views", std::move(views)}});
  }
  return {{"tracks", std::move(out)}};
}

void write_drive(const DriveResult& result, const DriveSurface& road, const RoadStripOptions& strip,
                 const fs::path& folder) {
  write_json(to_json(result.document), folder / "drive.json");
  write_file_atomically(folder / "trajectory.tum", [&](std::ostream& out) {
    for (const DriveFrame& frame : result.document.frames) {
      if (!frame.world_from_camera) continue;
      const Eigen::Vector3d t = frame.world_from_camera->translation();
      const Eigen::Quaterniond q = frame.world_from_camera->rotation();
      out << fmt::format("{:.9f} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g}\n", frame.time_s,
                         t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
    }
  });
  write_file_atomically(folder / "poses.txt", [&](std::ostream& out) {
    for (const DriveFrame& frame : result.document.frames) {
      if (!frame.world_from_camera) continue;
      const Eigen::Matrix4d m = frame.world_from_camera->matrix();
      for (int i = 0; i < 12; ++i) {
        out << fmt::format("{:.9g}{}", m(i / 4, i % 4), i < 11 ? " " : "\n");
      }
    }
  });
  write_json(to_json(result.tracks.vehicles), folder / "vehicles.json");
  write_json(to_json(result.tracks), folder / "tracks.json");
  write_file_atomically(folder / "tracks.csv", [&](std::ostream& out) {
    out << "track,class,motion,frame,time_s,x,y,z\n";
    for (const DriveTrack& track : result.tracks.tracks) {
      if (!track.rejected.empty()) continue;
      for (const DriveTrack::View& view : track.views) {
        const Eigen::Vector3d t = view.world_from_vehicle.translation();
        out << fmt::format("{},{},{},{},{:.6f},{:.4f},{:.4f},{:.4f}\n", track.id,
                           track.vehicle_class, track.parked ? "parked" : "moving", view.frame,
                           view.time_s, t.x(), t.y(), t.z());
      }
    }
  });
  write_strip(result, strip, folder / "strip");
  write_drive_surface(road, folder / "surface");
}

}  // namespace camber
