#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/coordinate_system.h"
#include "camber/core/progress.h"
#include "camber/export/gdal/cloud_optimized.h"
#include "camber/scene/results.h"
#include "camber/tiles/patch_tile.h"
#include "camber/tiles/raster_tile.h"
#include "camber/tiles/tile_plan.h"

namespace camber {

/// What is done with every tile of a plan.
struct TileJob {
  enum class Kind {
    kGround,   ///< ASPRS classes 2 and 1, as segment_ground() has them
    kFilter,   ///< leaves out points with few others near by, as radius_inliers() does
    kVoxels,   ///< one point for each cube, as VoxelGrid has them
    kNormals,  ///< adds normals, as estimate_normals() has them, up in z
    kPatches,  ///< pieces of patches, which join_patches() makes a surface of
    kCompare,  ///< adds `distance`, m, to the nearest point of another plan; NaN beyond the radius
    kLabels,   ///< adds `patch`, the patch of each point, once patches are joined
    kExport,   ///< rasters of the tile's own cells, as SiteRowsMaker has them, as GeoTIFF
    kProfile,  ///< the points of the ground near a line, for profile_cloud()
  };
  Kind kind = Kind::kGround;
  std::filesystem::path folder;  ///< of the results; empty: PLAN/KIND
  double radius = 0.0;           ///< m, of kFilter, kNormals and kCompare
  double voxel = 0.0;            ///< m, of kVoxels: edge of a cube
  /// kFilter: other points within the radius that a point needs, at least 1; kNormals: points of a
  /// plane, the nearest within the radius, at least 3.
  int neighbors = 0;
  /// kPatches: all but what the consistency graph and the driven line say, which is
  /// join_patches()'s.
  RoadSurfaceOptions surface;
  std::filesystem::path truth;                     ///< kCompare: folder of the other plan
  std::vector<double> thresholds{0.05, 0.1, 0.2};  ///< m, kCompare: counted are points within them
  std::filesystem::path patches;  ///< kLabels: folder of the joined patches; empty: PLAN/patches
  /// kExport, kProfile
  TileGroundFrom ground_from = TileGroundFrom::kJob;
  std::filesystem::path ground;   ///< kJob: folder of the joined ground; empty: PLAN/ground
  double step = 0.0;              ///< m, kExport: side of a cell; 0: by the points
  double fill_holes = 0.0;        ///< m, kExport: width of holes that are filled
  std::string crs;                ///< kExport: as write_cloud_optimized() takes it
  std::string height_unit = "m";  ///< kExport: of the bands
  /// kExport: write_cloud_optimized(), or who calls it: GDAL is not linked here.
  std::function<void(const RawRaster& raster, const std::string& crs,
                     const std::map<std::string, std::string>& metadata, const std::string& out)>
      write_raster;
  std::vector<Eigen::Vector3d> line;  ///< kProfile: m, in the plan's coordinates
  double half_width = 3.5;            ///< m, kProfile: as of CloudProfileOptions
  int num_threads = 0;                ///< <= 0: see resolve_num_threads

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// The coordinate system of a plan's tiles, completed: as it is given, else as the first one states
/// it.
std::optional<CoordinateSystem> system_of_tiles(const TilePlan& plan,
                                                const std::optional<CoordinateSystem>& given,
                                                const FindSystem& find);

/// kExport: sets what rasters state of a system. @throws NoAnswerError for longitudes and latitudes
void set_raster_system(const TilePlan& plan, const CoordinateSystem& system, TileJob* job);

/// "ground", "filter", "voxels", "normals", "patches", "compare", "labels", "export", "profile"
const char* to_string(TileJob::Kind kind);

/// What is written of a tile that is done, beside its file.
struct TileDone {
  std::string name;
  std::filesystem::path file;  ///< relative to the job's folder
  std::uint64_t points = 0, bytes = 0, read_points = 0;
  std::string hash;
  std::map<std::string, std::uint64_t> counts;  ///< of the job: "ground", "judged", "kept", ...
  std::optional<CellWindow> window;             ///< of kExport
  bool was_there = false;                       ///< done before; not written
};

/// Where a job's files stand.
std::filesystem::path job_folder(const TilePlan& plan, const TileJob& job);

/// Before the first tile: makes the folder with job.json, which holds the job's options.
/// @throws UsageError where it is there with others; OutputError where a foreign folder that is not
///         empty is in the place
void begin_tile_job(const TilePlan& plan, const TileJob& job);

/// Works on one tile: writes TILE.laz, the tile's file with what was found (kPatches:
/// TILE.patches, kExport: TILE.tif), then TILE.json. A tile that has both is passed over. Tiles can
/// be worked on in any order, by several processes at once, each any number of times: the files are
/// the same, bit for bit.
/// @throws InputError, NoAnswerError, OutputError
TileDone run_tile_job(const TilePlan& plan, const TileJob& job, std::size_t tile);

/// What was done with some tiles.
struct TilesRun {
  std::uint64_t points = 0;                            ///< of the results
  std::uint64_t done_before = 0;                       ///< tiles that were passed over
  std::uint64_t points_read = 0, points_answered = 0;  ///< of the others
  std::map<std::string, std::uint64_t> counts;         ///< as of TileDone
};

/// begin_tile_job(), then run_tile_job() on each; an interruption is looked for between them.
TilesRun run_tile_job(const TilePlan& plan, const TileJob& job,
                      const std::vector<std::size_t>& tiles, const Progress& progress = {});

/// The job of a name as to_string() has it. @throws std::invalid_argument
TileJob::Kind tile_job_from_string(const std::string& name);

/// Neighbours where none are given: 1 of kFilter, 30 of kNormals.
int default_neighbors(TileJob::Kind kind);

/// The tiles of shard `shard` of `shards`, which have no tile in common, together all, and each
/// about as many points.
/// @param shard  1 to `shards`
std::vector<std::size_t> tiles_of_shard(const TilePlan& plan, std::size_t shard,
                                        std::size_t shards);

/// Result of join_tiles().
struct JoinedTiles {
  std::filesystem::path index;
  std::uint64_t points = 0;
  std::map<std::string, std::uint64_t> counts;
  std::vector<TileDone> tiles;
};

/// Writes index.json over all tiles of a plan, once each is done; of any job but kPatches. Of
/// kExport also mosaic_path(): one raster of all (GDAL's virtual format).
/// @throws NoAnswerError where tiles are missing; InputError where files are not as they were left
JoinedTiles join_tiles(const TilePlan& plan, const TileJob& job);

/// Of kExport.
std::filesystem::path mosaic_path(const TilePlan& plan, const TileJob& job);

/// Of kProfile: the files of the tiles that have points near the line, once each is done, in the
/// order of the plan; sets the job's half_width and ground_from to those that they were made with.
/// @throws as join_tiles(); UsageError where they were made for another line
std::vector<std::filesystem::path> profile_files(const TilePlan& plan, TileJob* job);

/// Result of join_patches().
struct JoinedSurface {
  JoinedPatches patches;
  RoadSurfaceOptions options;   ///< as used
  std::uint64_t points = 0;     ///< of the plan's tiles
  std::uint64_t on_pieces = 0;  ///< of these, on pieces
};

/// Joins what kPatches left of all tiles; writes surface.json, the same by tiles
/// (write_surface_tiles()) and patches.ids (for kLabels) into the job's folder, which then is one
/// of a surface but for run.json.
/// @param job  its `surface` says what is up to the join; the rest is that of the tiles
/// @throws NoAnswerError where tiles are missing or no ground was found; InputError as join_tiles()
JoinedSurface join_patches(const TilePlan& plan, const TileJob& job);

/// What run.json says of a join of patches, but for the options and times of whoever ran it.
RunDocument run_document(const TilePlan& plan, const JoinedSurface& joined);

/// One file of joined results.
struct JoinedFile {
  std::filesystem::path path;
  Eigen::AlignedBox3d bounds;  ///< of its tile's points, in the files' units
};

/// Whether a folder has what join_tiles() writes.
bool is_joined(const std::filesystem::path& folder);
/// The files of joined results, in the order of the plan. @throws InputError
std::vector<JoinedFile> joined_files(const std::filesystem::path& folder);

}  // namespace camber
