#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/render/pictures.h"

namespace camber {

/// Versions of the libraries that results depend on, by name: Ceres, Eigen, OpenCV, VTK.
nlohmann::json library_versions();

/// What a report shows of one run.
struct ReportContent {
  PictureContent picture;                ///< cloud, surface, vehicles, run, camera, truth, title
  std::filesystem::path picture_folder;  ///< holds scene.png, bev.png, overlay_*.png, or those
                                         ///< of a comparison; may be empty
  JsonValue metrics;                     ///< metrics.json, or null
  /// Overlays as the bytes of a JPEG file, by the names of their PNG files; those that are not here
  /// are read from the folder.
  std::map<std::string, std::string> overlay_jpegs;
};

/// A report of a result folder, with the pictures and the metrics that lie in it; of anything else
/// the picture alone. @throws InputError for metrics that are no JSON.
ReportContent report_of_result(const PictureContent& content, const std::filesystem::path& result);

struct ReportOptions {
  bool embed_3d = true;            ///< a 3D view that works offline where the browser has WebGL
  std::size_t max_points = 40000;  ///< of the 3D view, > 0

  void validate() const;  ///< throws std::invalid_argument
};

/// One self-contained HTML page: pictures, height, grade and cross slope along the driven line with
/// their uncertainty, tables of patches and vehicles with margins, errors to the truth where known,
/// timings, version, seed, options, hashes of the inputs, the command. Nothing is loaded from
/// elsewhere and no script is needed to read it. Same input, same bytes.
/// @throws InputError for a picture that cannot be read; std::invalid_argument for bad options.
std::string make_report(const ReportContent& content, const ReportOptions& options = {});

/// Writes it, atomically. @throws OutputError also.
void write_report(const ReportContent& content, const std::filesystem::path& path,
                  const ReportOptions& options = {});

}  // namespace camber
