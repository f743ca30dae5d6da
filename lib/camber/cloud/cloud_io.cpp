#include "camber/cloud/cloud_io.h"

#include <algorithm>
#include <limits>

#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"
#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

/// Formats that are known, not read, and what to do about them.
const char* refusal_by_extension(const std::string& extension) {
  static const std::pair<const char*, const char*> kKnown[] = {
      {".obj", "Wavefront OBJ"}, {".stl", "STL"},   {".off", "OFF"},    {".npy", "NumPy"},
      {".npz", "NumPy"},         {".zip", "ZIP"},   {".gz", "gzip"},    {".rcp", "Autodesk RCP"},
      {".fls", "FARO FLS"},      {".drc", "Draco"}, {".xyzn", nullptr},
  };
  for (const auto& [known, name] : kKnown) {
    if (extension == known) return name;
  }
  return nullptr;
}

[[noreturn]] void refuse(const std::string& path, const std::string& format) {
  throw InputError(path, std::string("found ") + (format[0] == 'E' ? "an " : "a ") + format +
                             " file, which is not supported; expected PCD, PLY, KITTI .bin, "
                             "LAS, LAZ or text (other programs convert it)");
}

std::string extension_of(const std::filesystem::path& path) {
  return lower_case(path.extension().string());
}

bool starts_with(const FileReader& file, std::string_view magic) {
  return file.available() >= magic.size() && std::string_view(file.text(), magic.size()) == magic;
}

/// Whether the first line that is not a comment starts with a keyword of PCD headers.
bool looks_like_pcd(const FileReader& file) {
  std::string_view text(file.text(), std::min<std::size_t>(file.available(), 4096));
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    std::string_view line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    const std::string_view word = next_word(line);
    if (word.empty() || word[0] == '#') {
      if (lower_case(word).rfind("#.pcd", 0) == 0 || lower_case(next_word(line)) == ".pcd")
        return true;
      continue;
    }
    return word == "VERSION" || word == "FIELDS" || word == "COLUMNS";
  }
  return false;
}

std::optional<CloudFormat> format_from_content(FileReader& file) {
  file.fill(4096);
  if (starts_with(file, "ply") &&
      (file.available() == 3 || is_blank(file.text()[3]) || file.text()[3] == '\n')) {
    return CloudFormat::kPly;
  }
  if (starts_with(file, "LASF")) return CloudFormat::kLas;
  if (starts_with(file, "ASTM-E57")) return CloudFormat::kE57;
  if (looks_like_pcd(file)) return CloudFormat::kPcd;
  return std::nullopt;
}

std::unique_ptr<PointSource> open_whole(std::unique_ptr<FileReader> file,
                                        const ReadOptions& options) {
  std::optional<CloudFormat> format = options.format;
  // Names for columns are for files that have none themselves.
  if (!format && !options.columns.empty()) {
    const bool bin = format_from_extension(file->name()) == CloudFormat::kKittiBin;
    format = bin ? CloudFormat::kKittiBin : CloudFormat::kText;
  }
  if (!format) format = format_from_content(*file);
  const bool text = format.value_or(CloudFormat::kText) == CloudFormat::kText;
  if (text && extension_of(file->name()) == ".ptx") return open_ptx(std::move(file), options);
  if (!format) {
    const std::string extension = extension_of(file->name());
    format = format_from_extension(file->name());
    if (!format) {
      const char* const refused = refusal_by_extension(extension);
      if (refused != nullptr) refuse(file->name(), refused);
      throw InputError(file->name(), "found no known format in its first bytes and the extension " +
                                         shown(extension) +
                                         ", expected .pcd, .ply, .bin, .las, .laz, .xyz or .csv");
    }
  }
  if ((options.scan || options.own_frame) && *format != CloudFormat::kE57) {
    throw InputError(file->name(), "found a file without scans of a frame of their own (" +
                                       std::string(to_string(*format)) + "), expected E57");
  }
  switch (*format) {
    case CloudFormat::kPcd:
      return open_pcd(std::move(file), options);
    case CloudFormat::kPly:
      return open_ply(std::move(file), options);
    case CloudFormat::kKittiBin:
      return open_kitti_bin(std::move(file), options);
    case CloudFormat::kLas:
    case CloudFormat::kLaz:
      return open_las(std::move(file), options);
    case CloudFormat::kE57:
      return open_e57(std::move(file), options);
    case CloudFormat::kColmap:
      return open_colmap_points(std::move(file), options);
    case CloudFormat::kText:
      break;
  }
  return open_text(std::move(file), options);
}

std::unique_ptr<PointSource> open_source(std::unique_ptr<FileReader> file,
                                         const ReadOptions& options) {
  if (!options.bounds) return open_whole(std::move(file), options);
  options.bounds->validate();
  const std::string name = file->name();
  std::unique_ptr<PointSource> source = open_whole(std::move(file), options);
  if (options.triangles && source->report().faces > 0) {
    throw InputError(name, "found a mesh, which bounds do not cut, expected points");
  }
  return within_bounds(std::move(source), *options.bounds);
}

CloudFile collect(PointSource& source, const std::string& name, const ReadOptions& options) {
  constexpr std::uint64_t kMost = std::numeric_limits<int>::max();
  if (source.header().count.value_or(0) > kMost) {
    throw InputError(name, "found " + std::to_string(*source.header().count) +
                               " points, expected at most " + std::to_string(kMost));
  }
  CloudBuilder builder(source.header(), options.lenient && !options.triangles, options);
  PointBatch batch;
  while (source.next(batch)) {
    builder.add(batch);
    if (source.report().points > kMost) {
      throw InputError(name, "found more than " + std::to_string(kMost) + " points");
    }
  }
  CloudFile file;
  file.report = source.report();
  file.report.crs = source.header().crs;
  for (const std::string& what : file.report.las_only) {
    file.report.notes.push_back(what + " are not read");
  }
  file.cloud = builder.finish(file.report);
  file.triangles = std::move(source.triangles());
  return file;
}

}  // namespace

std::string_view to_string(CloudFormat format) {
  switch (format) {
    case CloudFormat::kPcd:
      return "pcd";
    case CloudFormat::kPly:
      return "ply";
    case CloudFormat::kKittiBin:
      return "bin";
    case CloudFormat::kLas:
      return "las";
    case CloudFormat::kE57:
      return "e57";
    case CloudFormat::kLaz:
      return "laz";
    case CloudFormat::kColmap:
      return "colmap";
    case CloudFormat::kText:
      break;
  }
  return "text";
}

std::optional<CloudFormat> format_from_extension(const std::filesystem::path& path) {
  const std::string name = path.filename().string();
  if (name == "points3D.bin" || name == "points3D.txt") return CloudFormat::kColmap;
  const std::string extension = extension_of(path);
  if (extension == ".pcd") return CloudFormat::kPcd;
  if (extension == ".ply") return CloudFormat::kPly;
  if (extension == ".bin") return CloudFormat::kKittiBin;
  if (extension == ".las") return CloudFormat::kLas;
  if (extension == ".e57") return CloudFormat::kE57;
  if (extension == ".laz") return CloudFormat::kLaz;
  for (const char* const text : {".xyz", ".txt", ".csv", ".asc", ".pts"}) {
    if (extension == text) return CloudFormat::kText;
  }
  return std::nullopt;
}

bool is_copc_name(const std::filesystem::path& path) {
  return extension_of(path) == ".laz" && extension_of(path.stem()) == ".copc";
}

std::unique_ptr<PointSource> open_point_source(const std::filesystem::path& path,
                                               const ReadOptions& options) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    for (const char* const name : {"points3D.bin", "points3D.txt"}) {
      if (std::filesystem::exists(path / name, error)) {
        return open_source(std::make_unique<FileReader>(path / name), options);
      }
    }
  }
  return open_source(std::make_unique<FileReader>(path), options);
}

std::unique_ptr<PointSource> open_point_source(const void* data, std::size_t size,
                                               const std::string& name,
                                               const ReadOptions& options) {
  return open_source(std::make_unique<FileReader>(data, size, name), options);
}

CloudFile read_cloud_file(const std::filesystem::path& path, const ReadOptions& options) {
  return collect(*open_point_source(path, options), path.string(), options);
}

CloudFile read_cloud_memory(const void* data, std::size_t size, const std::string& name,
                            const ReadOptions& options) {
  return collect(*open_point_source(data, size, name, options), name, options);
}

RoadCloud read_cloud(const std::filesystem::path& path, const ReadOptions& options) {
  return read_cloud_file(path, options).cloud;
}

std::unique_ptr<PointSink> make_point_sink(std::ostream& out, const PointStreamHeader& header,
                                           CloudFormat format, CloudEncoding encoding,
                                           const std::filesystem::path& beside) {
  const FieldRoles roles = find_roles(header.fields);
  if (roles.position[0] < 0 || roles.position[1] < 0) {
    throw std::invalid_argument("the points have no x or no y, expected both");
  }
  switch (format) {
    case CloudFormat::kPcd:
      return make_pcd_sink(out, header, encoding);
    case CloudFormat::kPly:
      return make_ply_sink(out, header, encoding);
    case CloudFormat::kKittiBin:
      if (encoding != CloudEncoding::kBinary) {
        throw std::invalid_argument("KITTI .bin files have one encoding, binary");
      }
      return make_kitti_bin_sink(out, header);
    case CloudFormat::kLas:
    case CloudFormat::kLaz: {
      const bool octree = format == CloudFormat::kLaz && encoding == CloudEncoding::kOctree;
      if (octree) return make_copc_sink(out, header, beside);
      if (encoding != CloudEncoding::kBinary) {
        throw std::invalid_argument("LAS and LAZ files have one encoding, binary");
      }
      const LasPoints points =
          format == CloudFormat::kLaz ? LasPoints::kCompressed : LasPoints::kPlain;
      return header.records ? make_las_copy_sink(out, header, points)
                            : make_las_sink(out, header, points);
    }
    case CloudFormat::kE57:
      throw std::invalid_argument(
          "E57 files are read only, expected ply, pcd, bin, las, laz or text");
    case CloudFormat::kColmap:
      throw std::invalid_argument(
          "COLMAP models are read only, expected ply, pcd, bin, las, laz or text");
    case CloudFormat::kText:
      break;
  }
  return make_text_sink(out, header, encoding);
}

CloudEncoding encoding_for(const std::filesystem::path& path, CloudFormat format,
                           CloudEncoding asked) {
  const bool octree =
      format == CloudFormat::kLaz && asked == CloudEncoding::kBinary && is_copc_name(path);
  if (octree) return CloudEncoding::kOctree;
  const bool commas = format == CloudFormat::kText && extension_of(path) == ".csv" &&
                      (asked == CloudEncoding::kBinary || asked == CloudEncoding::kAscii);
  return commas ? CloudEncoding::kCommas : asked;
}

void write_cloud(const RoadCloud& cloud, const std::filesystem::path& path,
                 const WriteOptions& options) {
  const std::optional<CloudFormat> format =
      options.format ? options.format : format_from_extension(path);
  if (!format) {
    throw std::invalid_argument(
        "output " + path.string() +
        ": found an unknown extension, expected .ply, .pcd, .bin, .las, .laz, "
        ".xyz or .csv");
  }
  const std::unique_ptr<PointSource> source = make_point_source(cloud);
  const CloudEncoding encoding = encoding_for(path, *format, options.encoding);
  write_file_atomically(path, [&](std::ostream& out) {
    std::unique_ptr<PointSink> sink;
    write_step(path,
               [&] { sink = make_point_sink(out, source->header(), *format, encoding, path); });
    PointBatch batch;
    while (source->next(batch)) write_step(path, [&] { sink->write(batch); });
    write_step(path, [&] { sink->finish(); });
  });
}

}  // namespace camber
