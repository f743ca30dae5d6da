#include "export_site.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/version.h"
#include "camber/export/site_bands.h"
#include "camber/export/site_points.h"
#include "camber/export/site_raster.h"
#include "camber/tiles/tile_job.h"
#include "cloud_arguments.h"
#include "crs.h"
#include "gdal_functions.h"
#include "ground_points.h"
#include "own_inputs.h"
#include "unknown_scale.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr std::size_t kStripBytes = std::size_t{512} << 20;
constexpr double kMostCells = 4e9;

/// What is known of a cloud before its raster.
struct Site {
  std::vector<JoinedFile> files;  // one, of bounds that are not known, or tiles
  ReadOptions reading;
  std::optional<PlanBounds> bounds;  // of what is answered
  CoordinateSystem crs;              // of unknown units where none is stated: metres
  std::string definition;            // of the system; empty: not known
  GroundSource source = GroundSource::kAuto;
  std::vector<signed char> labels;  // kCompute: of the file's points, 1 ground
  Eigen::AlignedBox3d box;
  std::uint64_t points = 0, ground = 0;
  double ground_spacing = 0.0;  // median, in units of the file
};

/// Calls visit(place, class, label of ground) for the points of a file that count, in their order;
/// what is not known is -1.
template <typename Visit>
void for_each_point_of(const std::filesystem::path& path, const Site& site, const Visit& visit) {
  ReadOptions reading = site.reading;
  reading.attributes = {"classification", "class_flags", "ground"};
  std::unique_ptr<PointSource> source = open_point_source(path, reading);
  if (reading.lenient) source = drop_bad_points(std::move(source));
  for_each_site_point(*source, [&](const SitePoint& point) {
    if (site.bounds && !site.bounds->contains(point.place.x(), point.place.y())) return;
    visit(point.place, point.kind,
          site.labels.empty() ? point.label : site.labels.at(point.number));
  });
}

/// The same for all files that reach into rows.
/// @param low, high  of y
template <typename Visit>
void for_each_point(const Site& site, double low, double high, const Visit& visit) {
  for (const JoinedFile& file : site.files) {
    const bool known = !file.bounds.isEmpty();
    if (known && (file.bounds.max().y() < low || file.bounds.min().y() > high)) continue;
    for_each_point_of(file.path, site, visit);
  }
}
template <typename Visit>
void for_each_point(const Site& site, const Visit& visit) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for_each_point(site, -kInfinity, kInfinity, visit);
}

bool is_ground(const Site& site, int kind, int label) {
  switch (site.source) {
    case GroundSource::kClasses:
      return is_ground_class(kind);
    case GroundSource::kAll:
      return kind != 9;  // water
    default:
      return label == 1;
  }
}

/// The ground by segment_ground(): of the points within bounds and a margin of their reach.
void compute_ground(const ExportArguments& args, const CommonOptions& common, const LogSink& warn,
                    Site* site) {
  GroundOptions options;
  options.num_threads = common.threads;
  if (site->bounds) {
    const double margin = in_units_of_file(args.input, site->reading, ground_margin(options));
    site->reading.bounds = site->bounds->grown(margin);
  }
  ReadOptions reading = site->reading;
  reading.attributes = {"classification", "class_flags"};
  CloudFile file = read_labelled_points(args.input, reading);
  use_metres(args.input, &file, {});
  const std::optional<std::vector<int>> judged = points_to_judge(file.cloud, {7, 9, 17, 18});
  GroundSegmentation found;
  if (judged) {
    found = segment_ground(file.cloud.select(*judged), options);
  } else {
    found = segment_ground(file.cloud, options);
  }
  if (found.status == Status::kFailed) throw NoAnswerError(args.input + ": " + found.reason);
  const std::string remark = remark_on_ground(found);
  if (!remark.empty() && warn) warn(args.input + ": " + remark);
  site->labels.assign(file.cloud.size(), 0);
  for (std::size_t i = 0; i < found.labels.size(); ++i) {
    const std::size_t at = judged ? static_cast<std::size_t>((*judged)[i]) : i;
    site->labels[at] = static_cast<signed char>(found.labels[i]);
  }
}

/// Where the ground comes from, if the user leaves it open.
GroundSource choose_source(const Site& site) {
  bool classified = false, labelled = false;
  for_each_point(site, [&](const Eigen::Vector3d&, int kind, int label) {
    classified = classified || is_ground_class(kind);
    labelled = labelled || label == 1;
  });
  return classified ? GroundSource::kClasses
         : labelled ? GroundSource::kLabels
                    : GroundSource::kCompute;
}

/// Bounds and numbers of the points, and how far apart those of the ground lie.
void measure(Site* site) {
  SiteSpacing spacing(site->crs.horizontal.metres);
  for_each_point(*site, [&](const Eigen::Vector3d& place, int kind, int label) {
    site->box.extend(place);
    ++site->points;
    if (!is_ground(*site, kind, label)) return;
    ++site->ground;
    spacing.add(place);
  });
  site->ground_spacing = spacing.spacing();
}

Site load_site(const ExportArguments& args, const CommonOptions& common) {
  Site site;
  const LogSink warn = make_warning_sink(common);
  site.reading = args.reading.read_options();
  site.bounds = site.reading.bounds;
  const bool tiles = is_joined(args.input);
  if (tiles) {
    site.files = joined_files(args.input);
  } else {
    site.files.push_back({args.input, {}});
  }
  const std::unique_ptr<PointSource> source =
      open_point_source(site.files.front().path, site.reading);
  const PointStreamHeader& header = source->header();
  const bool in_lengths = header.crs && (header.crs->horizontal.known() || header.crs->epsg != 0);
  if (!header.metric && !in_lengths) {
    throw NoAnswerError(args.input +
                        ": the cloud is up to an unknown scale, and a raster is in metres");
  }
  if (header.frame == CloudFrame::kCamera) {
    throw NoAnswerError(args.input +
                        ": the cloud is in its camera's frame, and a raster lies on a map; give "
                        "import --gnss, or a line with --along FILE");
  }
  if (header.crs) {
    site.crs = *header.crs;
    complete_crs(&site.crs);
    if (site.crs.horizontal.angle) throw NoAnswerError(args.input + ": " + unit_remark(site.crs));
    site.definition = definition_for_raster(site.crs);
  }
  site.source = ground_source_from(args.ground_from);
  if (site.source == GroundSource::kAuto) site.source = choose_source(site);
  if (site.source == GroundSource::kCompute && tiles) {
    throw NoAnswerError(args.input +
                        ": the tiles have no classes of ground; camber tiles run "
                        "--job ground finds it");
  }
  if (site.source == GroundSource::kCompute) compute_ground(args, common, warn, &site);
  measure(&site);
  if (site.points == 0) {
    throw NoAnswerError(args.input + (site.bounds ? ": no point lies within --bounds"
                                                  : ": found no point that counts"));
  }
  if (site.ground == 0) {
    throw NoAnswerError(fmt::format("{}: found no point of the ground (--ground-from {})",
                                    args.input, to_string(site.source)));
  }
  return site;
}

/// A file that is removed at the end, with bands one behind the other.
class BandFile {
 public:
  BandFile(const fs::path& beside, std::size_t bands, std::size_t band_bytes)
      : beside_(beside), path_(files_.stage(beside)), band_bytes_(band_bytes) {
    std::error_code ignored;
    const fs::path folder = fs::absolute(path_).parent_path();
    const fs::space_info space = fs::space(folder, ignored);
    // Its own size, and as much again for the result with its overviews.
    const double wanted = 2.0 * static_cast<double>(bands) * static_cast<double>(band_bytes);
    if (!ignored && static_cast<double>(space.available) < wanted) {
      throw OutputError(beside_.string(),
                        fmt::format("{:.1f} GB are free on the disk, expected {:.1f}",
                                    1e-9 * static_cast<double>(space.available), 1e-9 * wanted));
    }
    file_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (file_ < 0) fail();
  }
  ~BandFile() { close(); }
  BandFile(const BandFile&) = delete;
  BandFile& operator=(const BandFile&) = delete;

  void write(std::size_t band, std::size_t offset, const void* data, std::size_t size) {
    const char* bytes = static_cast<const char*>(data);
    std::size_t at = band * band_bytes_ + offset;
    while (size > 0) {
      const ssize_t written = ::pwrite(file_, bytes, size, static_cast<off_t>(at));
      if (written < 0 && errno == EINTR) continue;
      if (written <= 0) fail();
      bytes += written;
      at += static_cast<std::size_t>(written);
      size -= static_cast<std::size_t>(written);
    }
  }
  void close() {
    if (file_ >= 0) ::close(file_);
    file_ = -1;
  }
  const fs::path& path() const { return path_; }

 private:
  [[noreturn]] void fail() const { throw OutputError(beside_.string(), std::strerror(errno)); }

  fs::path beside_;
  AtomicFiles files_;
  fs::path path_;
  std::size_t band_bytes_;
  int file_ = -1;
};

/// How much of a raster is known.
struct Answered {
  std::uint64_t known = 0, cells = 0;              // of the ground
  std::uint64_t known_occupied = 0, occupied = 0;  // of cells with points
};

/// Makes the raster strip by strip: each reads the points anew.
Answered make_rows(const Site& site, const SiteGrid& grid, const SiteRasterOptions& options,
                   BandFile* bands, BandFile* shades) {
  const std::size_t columns = grid.columns;
  // Of points as many as the mean of all rows has.
  const double bytes = static_cast<double>(SiteRowsMaker::bytes_of_row(grid)) +
                       static_cast<double>(SiteRowsMaker::bytes_of_point()) *
                           static_cast<double>(site.ground) / static_cast<double>(grid.rows);
  const auto strip =
      static_cast<std::size_t>(std::max(1.0, std::floor(static_cast<double>(kStripBytes) / bytes)));
  Answered out;
  for (std::size_t first = 0; first < grid.rows; first += strip) {
    const std::size_t rows = std::min(strip, grid.rows - first);
    SiteRowsMaker maker(grid, first, rows, options);
    // As far around the rows as SiteRowsMaker keeps points.
    const double margin = 2.0 * options.reach + 3.0 * grid.cell;
    const double top = grid.north - static_cast<double>(first) * grid.cell;
    const double bottom = top - static_cast<double>(rows) * grid.cell;
    for_each_point(site, bottom - margin, top + margin,
                   [&](const Eigen::Vector3d& place, int kind, int label) {
                     maker.add(place, is_ground(site, kind, label));
                   });
    SiteRows found = maker.finish();
    for (std::size_t i = 0; i < found.ground.size(); ++i) {
      const bool known = !std::isnan(found.ground[i]), occupied = found.points[i] > 0.0f;
      out.known += known ? 1 : 0;
      out.occupied += occupied ? 1 : 0;
      out.known_occupied += known && occupied ? 1 : 0;
    }
    out.cells += found.ground.size();
    if (shades) {
      std::vector<std::uint8_t> grey(found.shades.size(), 0);
      for (std::size_t i = 0; i < grey.size(); ++i) {
        // 0 is what is not known.
        if (!std::isnan(found.shades[i])) {
          grey[i] = static_cast<std::uint8_t>(std::lround(1.0 + 254.0 * found.shades[i]));
        }
      }
      shades->write(0, first * columns, grey.data(), grey.size());
    }
    std::size_t number = 0;
    for (const std::vector<float>& band : site_band_values(std::move(found))) {
      bands->write(number++, first * columns * sizeof(float), band.data(),
                   band.size() * sizeof(float));
    }
  }
  return out;
}

SiteGrid grid_of(const ExportArguments& args, const Site& site) {
  const double metre = site.crs.horizontal.metres;
  const double cell =
      args.grid.step_u > 0.0 ? args.grid.step_u / metre : site_cell(site.ground_spacing);
  // One point astray makes a raster of nothing. A survey with as many empty cells to a point is
  // none.
  constexpr double kMostCellsOfAPoint = 1000.0, kFewCells = 1e7;
  const Eigen::Vector2d sides = site.box.sizes().head<2>() / cell;
  const double most = std::min(
      kMostCells, std::max(kFewCells, kMostCellsOfAPoint * static_cast<double>(site.points)));
  if (!((sides.x() + 1.0) * (sides.y() + 1.0) <= most)) {
    throw NoAnswerError(fmt::format(
        "{}: {:.0f} x {:.0f} cells of {:g} are too many for {} points; larger cells (--step) or a "
        "part (--bounds) give fewer",
        args.input, sides.x() + 1.0, sides.y() + 1.0, cell, site.points));
  }
  return {site.box.min().head<2>(), site.box.max().head<2>(), cell};
}

}  // namespace

bool is_site(const ExportArguments& args) {
  return args.target == "geotiff" && args.line.empty() &&
         (!is_surface(args.input) || is_joined(args.input));
}

json export_site(const CommonOptions& common, const ExportArguments& args, Timings& timings) {
  const GdalFunctions& writer = gdal_functions();
  check_output_file(args.hillshade);
  refuse_own_inputs({args.out, args.hillshade}, {args.input});
  StageTimer load(timings, "load");
  const Site site = load_site(args, common);
  load.stop();
  StageTimer compute(timings, "compute");
  const SiteGrid grid = grid_of(args, site);
  SiteRasterOptions options;
  options.num_threads = common.threads;
  options.height_per_length = site.crs.vertical.metres / site.crs.horizontal.metres;
  options.reach =
      site_reach(grid.cell, site.ground_spacing, args.fill_holes / site.crs.horizontal.metres);
  const std::size_t cells = grid.columns * grid.rows;
  const std::string height_unit = height_unit_of(site.crs);
  RawRaster heights;
  heights.grid = grid;
  heights.bands = site_bands(height_unit);
  BandFile bands(args.out + ".raw", heights.bands.size(), cells * sizeof(float));
  std::optional<BandFile> shades;
  if (!args.hillshade.empty()) shades.emplace(args.hillshade + ".raw", 1, cells);
  const Answered answered = make_rows(site, grid, options, &bands, shades ? &*shades : nullptr);
  if (answered.known == 0) {
    throw NoAnswerError(args.input + ": the ground's points lie too far apart for cells of " +
                        fmt::format("{:g}; larger cells (--step) hold more", grid.cell));
  }
  compute.stop();
  StageTimer write(timings, "write");
  bands.close();
  heights.file = bands.path();
  heights.name = args.out;
  std::map<std::string, std::string> metadata = {
      {"TIFFTAG_SOFTWARE", std::string("Camber ") + kVersion},
      {"TIFFTAG_IMAGEDESCRIPTION", "ground and surface of a cloud's points"},
      {"CAMBER_GROUND_FROM", to_string(site.source)}};
  AtomicFiles files;
  writer.write_cloud_optimized(heights, site.definition, metadata, files.stage(args.out));
  if (shades) {
    shades->close();
    RawRaster shade;
    shade.file = shades->path();
    shade.name = args.hillshade;
    shade.grid = grid;
    shade.bytes = true;
    shade.bands = {{"hillshade", ""}};
    metadata["TIFFTAG_IMAGEDESCRIPTION"] =
        "hillshade of the ground: light from the north-west, 45 degrees high";
    writer.write_cloud_optimized(shade, site.definition, metadata, files.stage(args.hillshade));
  }
  throw_if_interrupted();
  files.commit();
  write.stop();
  const double share = [&] {
    const double all = static_cast<double>(answered.occupied);
    return 1.0 - static_cast<double>(answered.known_occupied) / std::max(all, 1.0);
  }();
  if (!args.as_json) {
    fmt::print(
        "{}: {} x {} cells of {:g} {}, {} of {} points are ground ({}), {:.1f} % of the "
        "cells with points have no ground\n",
        args.out, grid.columns, grid.rows, grid.cell,
        site.crs.horizontal.known() ? site.crs.horizontal.name : "m", site.ground, site.points,
        to_string(site.source), 100.0 * share);
  }
  return {{"columns", grid.columns},
          {"rows", grid.rows},
          {"cell", grid.cell},
          {"west", grid.west},
          {"north", grid.north},
          {"unknown", answered.cells - answered.known},
          {"unanswered_share", share},
          {"points", site.points},
          {"ground_points", site.ground},
          {"ground_from", to_string(site.source)},
          {"height_unit", height_unit},
          {"hillshade", args.hillshade.empty() ? json(nullptr) : json(args.hillshade)},
          {"geo_reference", site.definition}};
}

}  // namespace camber::tools
