#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/cloud/coordinate_system.h"
#include "camber/cloud/plan_bounds.h"
#include "camber/cloud/road_cloud.h"

namespace camber {

/// File formats of point clouds.
enum class CloudFormat {
  kPcd,       ///< Point Cloud Library: ASCII, binary or binary_compressed
  kPly,       ///< Polygon files: ASCII, little or big endian; vertices are the points
  kKittiBin,  ///< KITTI's velodyne scans: little-endian float32 x y z reflectance; others alike
  kLas,       ///< LAS 1.0 to 1.5, uncompressed
  kLaz,       ///< LAS compressed by LASzip
  kE57,       ///< ASTM E2807; read only
  kText,      ///< XYZ or CSV: one point a line; PTX (read only)
  kColmap,    ///< points3D.bin or points3D.txt of a COLMAP model; read only
};

/// "pcd", "ply", "bin", "las", "laz", "e57", "text", "colmap".
std::string_view to_string(CloudFormat format);

/// Whether a format's files have LAS records: LAS itself, and LAZ.
inline bool is_las(std::optional<CloudFormat> format) {
  return format == CloudFormat::kLas || format == CloudFormat::kLaz;
}

/// The format that a file name's extension stands for (any case): .pcd, .ply, .bin, .las, .laz,
/// .e57, .xyz, .txt, .csv, .asc, .pts for text (.ptx is read, not written); files named
/// points3D.bin and points3D.txt are COLMAP's; nothing for others.
std::optional<CloudFormat> format_from_extension(const std::filesystem::path& path);

/// Whether a name ends as those of COPC files do: .copc.laz.
bool is_copc_name(const std::filesystem::path& path);

struct ReadOptions {
  /// false: anything unsound is an error. true: what can be read is kept, what cannot (truncated
  /// tails, bad lines, points that are not finite, out of range or exact duplicates) is dropped
  /// and counted in the report.
  bool lenient = false;
  /// Overrides the recognition by content and extension; for text this is needed where the
  /// extension is not one of text.
  std::optional<CloudFormat> format;
  /// Names of the columns of a text file without a header line, or of the floats of a point of a
  /// .bin ("x", "y", "z", "intensity", ...; "_" skips one). Empty: the header line, or x y z and
  /// further columns by number; of a .bin what its numbers show (KITTI 4, nuScenes 5, others 3, 6).
  std::vector<std::string> columns;
  /// The coordinate system of the file, whatever it states itself.
  std::optional<CoordinateSystem> crs;
  /// E57 only: the number of the scan to read, from 0; without it all scans are one cloud.
  std::optional<std::size_t> scan;
  /// E57 only: leave out the pose of the scan, which must be the file's only one or `scan`.
  bool own_frame = false;
  /// Points outside are left out; see ReadReport::outside. Not of meshes.
  std::optional<PlanBounds> bounds;
  /// PLY only: keep the faces, split into triangles (fans).
  bool triangles = false;
  /// LAZ only: threads that decode; <= 0: all, see resolve_num_threads.
  int num_threads = 0;
  /// COPC only: levels of the octree down to the first whose points are no farther apart, in the
  /// units of the file; 0: all.
  double resolution = 0.0;
  /// Attributes to read beside the coordinates, by their names in the file; none: all. Layers of
  /// LAZ that hold no others are not decoded, and points have no records.
  std::optional<std::vector<std::string>> attributes;

  bool wants(const std::string& attribute) const {
    return !attributes ||
           std::find(attributes->begin(), attributes->end(), attribute) != attributes->end();
  }
};

/// How a text file is laid out.
struct TextLayout {
  std::string separator;         ///< "comma", "semicolon", "blanks or tabs"
  std::string line_ends = "LF";  ///< or "CR LF", by the first line
  char decimal_sign = '.';
  std::uint64_t header_lines = 0;   ///< comments, names and the like before the points
  std::vector<std::string> header;  ///< the first of them, as UTF-8
  std::size_t columns = 0;
  std::array<int, 3> position{-1, -1, -1};  ///< columns of x, y and z, from 0
  std::optional<std::uint64_t> count_line;  ///< the number of points in the first line
};

/// One scan of a PTX file.
struct PtxScan {
  std::uint64_t columns = 0, rows = 0;
  /// Lines 7 to 10: a point is the row vector (x y z 1) times this matrix; row by row.
  std::array<double, 16> pose{};
};

/// What a reader found out about a file beside its points.
struct ReadReport {
  CloudFormat format = CloudFormat::kPly;
  std::string encoding;        ///< "ascii", "binary little endian", "binary_compressed", ...
  std::uint64_t declared = 0;  ///< points that the header promises; 0 if it states none
  std::uint64_t points = 0;    ///< points handed out
  std::uint32_t width = 0;     ///< columns of an organised PCD, else 0
  std::uint32_t height = 0;    ///< rows of an organised PCD, else 0
  std::uint64_t faces = 0;     ///< faces of a PLY
  std::uint64_t outside = 0;   ///< points that were read and left out as outside of the bounds
  /// Points with a NaN or infinite coordinate. They are kept unless the reading is lenient.
  std::uint64_t non_finite = 0;
  /// Points with finite coordinates and a NaN or infinite attribute (a time stamp); kept.
  std::uint64_t non_finite_attributes = 0;
  /// Lenient reading: reason ("truncated", "not finite", ...) and number of points dropped for it.
  /// Of E57 always "invalid in the file": points that the file itself marks so.
  std::vector<std::pair<std::string, std::uint64_t>> dropped;
  /// Remarks a user may want to see, one sentence each.
  std::vector<std::string> notes;
  std::optional<CoordinateSystem> crs;  ///< where the file, or ReadOptions, states one
  std::optional<TextLayout> text;       ///< of a text file
  std::vector<PtxScan> scans;           ///< of a PTX file, the first 64
  /// E57: number of a scan that was read, and how many of its points the file marks as invalid.
  std::vector<std::pair<std::size_t, std::uint64_t>> invalid_by_scan;
  /// What the points have that is not among their attributes and that only another LAS file keeps:
  /// "wave packets", ...
  std::vector<std::string> las_only;

  void drop(const std::string& reason, std::uint64_t count = 1);  ///< adds to `dropped`
};

/// A cloud with what came along with it.
struct CloudFile {
  RoadCloud cloud;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< indices of points; see ReadOptions
  ReadReport report;
};

/// Reads a cloud. The format is recognised by the file's first bytes, then by its extension. A
/// folder with a points3D.bin or points3D.txt is a COLMAP model.
///
/// Attributes by name, in any case: x y z; red green blue (or r g b, or PCL's packed rgb); nx ny nz
/// (or normal_x ...); sigma; cov_xx cov_xy cov_xz cov_yy cov_yz cov_zz. Other integers become
/// labels, other numbers scalars, under the name that they have in the file. Coordinates are read
/// in double; where they are large (map coordinates) `origin` takes the round part.
///
/// The file is not trusted: each count, size and type is checked against the file's real size
/// before memory is taken. Memory is a small multiple of the file's size, time is linear in it.
/// @throws InputError "file: line N / byte N: what was found, what was expected".
CloudFile read_cloud_file(const std::filesystem::path& path, const ReadOptions& options = {});

/// The same for a file that is in memory already.
/// @param name stands for the path in messages and gives the extension.
CloudFile read_cloud_memory(const void* data, std::size_t size, const std::string& name,
                            const ReadOptions& options = {});

/// The cloud alone; see read_cloud_file.
RoadCloud read_cloud(const std::filesystem::path& path, const ReadOptions& options = {});

enum class CloudEncoding {
  kBinary,  ///< little endian; for text blanks between the values
  kAscii,
  kBigEndian,   ///< PLY only
  kCompressed,  ///< PCD only
  kCommas,      ///< text only: commas and a line of names
  kOctree,      ///< LAZ only: the nodes of an octree, COPC; of names that end in .copc.laz
};

struct WriteOptions {
  /// None: by the extension.
  std::optional<CloudFormat> format;
  /// Text in a file that ends in .csv gets commas, LAZ in one that ends in .copc.laz an octree.
  CloudEncoding encoding = CloudEncoding::kBinary;
};

/// Writes a cloud, atomically, with all attributes that the format can hold (KITTI .bin: x y z and
/// the scalar "intensity" or "reflectance", else 0). With a non-zero origin the true coordinates
/// are written, in double where the format has it. Frame, scale and origin go into header comments
/// of PLY, PCD and text ("comment camber frame camera", "comment camber metric false",
/// "comment camber origin X Y Z").
/// @throws OutputError if it cannot be written; std::invalid_argument for a cloud that does not
///         validate(), an extension without a format, or an encoding that the format lacks.
void write_cloud(const RoadCloud& cloud, const std::filesystem::path& path,
                 const WriteOptions& options = {});

}  // namespace camber
