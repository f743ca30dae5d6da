#include "camber/drive/drive_pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <vector>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/image/image_io.h"
#include "camber/image/undistortion.h"
#include "camber/image/video.h"
#include "camber/render/canvas.h"
#include "camber/render/drive_painter.h"
#include "camber/render/drive_plots.h"
#include "camber/render/drive_report.h"
#include "camber/render/film.h"
#include "camber/render/overlay.h"
#include "camber/render/picture_file.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr int kPictureWidth = 720;  // pixels, of a frame's picture in the report
constexpr int kPictureQuality = 78;

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw OutputError(folder.string(), error.message());
}

/// Indices of the frames whose picture the report has.
std::set<int> evenly(std::size_t count, int most) {
  std::set<int> out;
  const double step = std::max(1.0, static_cast<double>(count) / most);
  for (double at = 0.0; at < static_cast<double>(count) - 0.5; at += step) {
    out.insert(static_cast<int>(at));
  }
  return out;
}

std::string read_bytes(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  if (!in) throw InputError(path.string(), "cannot be read");
  return out.str();
}

/// The photographs of frames one after the other; grey, with the reason, where one cannot be read.
class Photos {
 public:
  explicit Photos(const Scene& scene) : scene_(scene), lens_(scene.camera, scene.distortion) {}

  Image of(int id) {
    const SceneFrame* frame = scene_.find_frame(id);
    try {
      if (frame && !frame->image.empty()) return reader_->read(frame->image, lens_).color;
    } catch (const InputError&) {
      reader_ = std::make_unique<FrameImageReader>();
    }
    Image out = make_picture(scene_.camera.width, scene_.camera.height, 90);
    Canvas canvas(out);
    canvas.text({0.5 * out.width, 0.5 * out.height}, fmt::format("no image of frame {}", id), 24.0,
                {255, 255, 255, 1.0}, TextAnchor::kCenter);
    return out;
  }

 private:
  const Scene& scene_;
  Undistortion lens_;
  std::unique_ptr<FrameImageReader> reader_ = std::make_unique<FrameImageReader>();
};

/// The pieces of one film.
class Pieces {
 public:
  Pieces(const Scene& scene, const DriveContent& content, const DriveFilmOptions& options)
      : content_(content),
        options_(options),
        painter_(content),
        photos_(scene),
        rate_(film_rate(*content.drive)),
        wanted_(evenly(content.drive->frames.size(), options.most_pictures)) {}

  std::size_t count() const {
    const auto each = static_cast<std::size_t>(options_.frames_a_piece);
    return (content_.drive->frames.size() + each - 1) / each;
  }
  fs::path file(std::size_t piece) const {
    return options_.pieces / fmt::format("{:06d}{}", piece, options_.film.extension().string());
  }
  fs::path picture_file(int index) const {
    return options_.pieces / fmt::format("frame_{:06d}.jpg", index);
  }
  const std::set<int>& wanted() const { return wanted_; }

  /// Pieces know nothing of one another, so that one made by another run is the same.
  void draw(std::size_t piece, const Progress& progress) {
    const std::size_t each = static_cast<std::size_t>(options_.frames_a_piece);
    const std::size_t all = content_.drive->frames.size();
    FilmWriter film(file(piece), rate_);
    LabelMemory labels;
    for (std::size_t i = piece * each; i < std::min(all, (piece + 1) * each); ++i) {
      throw_if_interrupted();
      if (progress) progress("film", static_cast<double>(i) / static_cast<double>(all));
      const Image overlay = painter_.overlay(photos_.of(content_.drive->frames[i].id), i, &labels);
      film.add(painter_.picture(overlay, i));
      const int index = static_cast<int>(i);
      if (wanted_.count(index) > 0) {
        write_file_atomically(
            picture_file(index),
            encode_jpeg(shrink_picture(overlay, std::min(overlay.width, kPictureWidth)),
                        kPictureQuality));
      }
    }
    film.finish();
  }

 private:
  const DriveContent& content_;
  const DriveFilmOptions& options_;
  DrivePainter painter_;
  Photos photos_;
  double rate_;
  std::set<int> wanted_;
};

}  // namespace

DriveContent drive_content(const Scene& scene, const DriveResult& result,
                           const DriveSurface& road) {
  DriveContent out;
  out.drive = &result.document;
  out.strip = &result.strip;
  out.surface = &road.surface;
  out.vehicles = &result.tracks.vehicles;
  out.stations = road.stations;
  out.camera = scene.camera;
  out.title = scene.name;
  for (const DriveTrack& track : result.tracks.tracks) {
    if (!track.rejected.empty()) continue;
    DriveTrackLine line;
    line.id = track.id;
    line.vehicle_class = track.vehicle_class;
    line.parked = track.parked;
    line.dimensions = track.dimensions;
    for (const DriveTrack::View& view : track.views) {
      line.places.push_back({view.frame, view.world_from_vehicle.translation()});
    }
    out.tracks.push_back(std::move(line));
  }
  return out;
}

double film_rate(const DriveDocument& drive) {
  constexpr double kUnknown = 10.0, kSlowest = 0.5, kFastest = 120.0;  // Hz
  if (drive.frames.size() < 2) return kUnknown;
  const double span = drive.frames.back().time_s - drive.frames.front().time_s;
  if (!(span > 0.0)) return kUnknown;
  return std::clamp(static_cast<double>(drive.frames.size() - 1) / span, kSlowest, kFastest);
}

std::map<int, std::string> write_drive_film(const Scene& scene, const DriveContent& content,
                                            const DriveFilmOptions& options,
                                            const Progress& progress) {
  make_folder(options.pieces);
  Pieces pieces(scene, content, options);
  std::vector<fs::path> files;
  for (std::size_t piece = 0; piece < pieces.count(); ++piece) {
    std::error_code error;
    if (!fs::exists(pieces.file(piece), error)) pieces.draw(piece, progress);
    files.push_back(pieces.file(piece));
  }
  std::map<int, std::string> pictures;
  for (const int index : pieces.wanted()) {
    pictures[index] = read_bytes(pieces.picture_file(index));
  }
  join_films(files, options.film);
  if (progress) progress("film", 1.0);
  return pictures;
}

void write_drive_report(const DriveContent& content, const nlohmann::json& run,
                        std::map<int, std::string> pictures, const std::string& film,
                        const fs::path& folder) {
  const fs::path plots = folder / "plots";
  make_folder(plots);
  const std::vector<ProfilePoint> profile = drive_profile(content);
  try {
    const PlotSheet map = drive_map(content, profile);
    write_png(draw_plots(map, {1400, map_height(map, 1400), 20.0}), plots / "map.png");
    write_png(draw_plots(drive_profile_plots(content, profile), {1400, 330, 20.0}),
              plots / "profile.png");
  } catch (const NoAnswerError&) {
    // A drive of which there is nothing to draw has a page all the same.
  }
  DriveReport report;
  report.content = content;
  report.run = run;
  report.pictures = std::move(pictures);
  report.film = film;
  write_file_atomically(folder / "report.html", make_drive_report(report));
}

}  // namespace camber
