#include "camber/tiles/plan_tiles.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>

#include "camber/cloud/las_chunks.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/morton.h"
#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"
#include "camber/scene/json_reader.h"
#include "camber/tiles/detail/tile_grid.h"
#include "camber/tiles/detail/tile_spills.h"
#include "camber/tiles/ground_tile.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using detail::TileAxis;
using detail::TileSpills;
using nlohmann::json;

constexpr double kPointsOfTile = 1e7;
constexpr std::uint64_t kPartPoints = 50000;  // of a chunk that the LAZ writer writes
constexpr std::size_t kMostTiles = 1000000;

/// An input as its header describes it.
struct Input {
  fs::path path;
  PointStreamHeader header;
  std::uint64_t bytes = 0, points = 0;
};

/// What must be the same in all inputs for one coordinate system.
std::string system_of(const PointStreamHeader& header) {
  if (!header.crs) return {};
  const CoordinateSystem& crs = *header.crs;
  if (crs.epsg != 0) {
    return fmt::format("EPSG:{}{}", crs.epsg,
                       crs.vertical_epsg != 0 ? fmt::format("+{}", crs.vertical_epsg) : "");
  }
  return crs.wkt.empty() ? describe(crs) : crs.wkt;
}

std::string crs_in_words(const PointStreamHeader& header) {
  return header.crs && header.crs->stated() ? describe(*header.crs) : std::string();
}

std::string extra_bytes_of(const LasFile& las) {
  std::string out;
  for (const LasExtraBytes& e : las.extra_bytes) {
    out += fmt::format("{} {} {} {} {} {};", e.name, e.type, e.options, e.elements,
                       fmt::join(e.scale, " "), fmt::join(e.offset, " "));
  }
  return out;
}

ReadOptions reading_of(const TilePlanOptions& options) {
  ReadOptions reading;
  reading.crs = options.crs;
  if (reading.crs) reading.crs->given = true;  // so that the tiles state it
  reading.num_threads = options.num_threads;
  return reading;
}

/// Reads the headers, and refuses files that cannot be tiles of one cloud.
std::vector<Input> open_inputs(const std::vector<fs::path>& paths, const TilePlanOptions& options) {
  std::vector<Input> out;
  for (const fs::path& path : paths) {
    throw_if_interrupted();
    const std::unique_ptr<PointSource> source = open_point_source(path, reading_of(options));
    Input input{path, source->header()};
    const LasFile* const las = input.header.las.get();
    if (!las) {
      throw InputError(path.string(),
                       "found a file of another format, expected LAS, LAZ or COPC "
                       "(camber convert writes them)");
    }
    if (!(las->scale[0] > 0.0 && las->scale[1] > 0.0 && las->scale[2] > 0.0)) {
      throw InputError(path.string(), "found a negative scale, expected scales above 0");
    }
    std::error_code error;
    input.bytes = fs::file_size(path, error);
    if (error) throw InputError(path.string(), error.message());
    input.points = las->points;
    if (!out.empty()) {
      const Input& first = out.front();
      const std::string here = system_of(input.header), there = system_of(first.header);
      if (here != there) {
        throw InputError(path.string(),
                         fmt::format("found {}, expected {} as in {}; --crs states one for all",
                                     here.empty() ? "no coordinate system" : here,
                                     there.empty() ? "none" : there, first.path.string()));
      }
      const LasFile& other = *first.header.las;
      const bool same_records = las->point_format == other.point_format &&
                                las->record_length == other.record_length &&
                                extra_bytes_of(*las) == extra_bytes_of(other) &&
                                (las->global_encoding & 1) == (other.global_encoding & 1);
      if (!options.in_place && !same_records) {
        throw InputError(
            path.string(),
            fmt::format("found points of format {} with {} bytes, expected format {} with {} bytes "
                        "and the same attributes and kind of times as in {}; tiles with different "
                        "points are taken --in-place",
                        las->point_format, las->record_length, other.point_format,
                        other.record_length, first.path.string()));
      }
    }
    const int format = las->point_format;
    if (!options.in_place && (format == 4 || format == 5 || format > 8)) {
      throw InputError(path.string(), fmt::format("found points with wave packets (format {}), "
                                                  "which are not moved to tiles; expected another "
                                                  "format, or tiles that are taken --in-place",
                                                  format));
    }
    out.push_back(std::move(input));
  }
  return out;
}

json request_of(const std::vector<Input>& inputs, const TilePlanOptions& options) {
  json files = json::array();
  for (const Input& input : inputs) {
    files.push_back(
        {{"file", input.path.generic_string()}, {"bytes", input.bytes}, {"points", input.points}});
  }
  return {{"inputs", files},
          {"in_place", options.in_place},
          {"tile", options.side},
          {"tile_origin", options.origin},
          {"crs", options.crs ? json(describe(*options.crs)) : json(nullptr)},
          {"cell", options.ground.cell},
          {"largest_object", options.ground.largest_object},
          {"slope", options.ground.slope},
          {"tolerance", options.ground.tolerance},
          {"keep_classes", options.keep_classes}};
}

/// The first key of a request in which another one differs; empty: none.
std::string difference(const json& a, const json& b) {
  for (const auto& [key, value] : a.items()) {
    if (!b.is_object() || b.count(key) == 0 || b.at(key) != value) return key;
  }
  return {};
}

/// The folder of a plan while it is made.
class Workplace {
 public:
  Workplace(const fs::path& folder, json request, bool overwrite)
      : folder_(folder), request_(std::move(request)) {
    std::error_code error;
    const bool there = fs::exists(folder, error);
    if (there && !fs::is_directory(folder, error)) {
      throw OutputError(folder.string(), "found a file, expected a folder or nothing");
    }
    const bool ours = fs::exists(folder / "index.json", error) || fs::exists(work(), error);
    if (there && !ours && !fs::is_empty(folder, error)) {
      throw OutputError(folder.string(),
                        "the folder is not empty and not a plan of tiles; expected a new one");
    }
    if (ours) take_over(overwrite);
    if (complete_) return;
    for (const fs::path& made : {work() / "spills", folder_ / "tiles"}) {
      fs::create_directories(made, error);
      if (error) throw OutputError(made.string(), error.message());
    }
  }

  bool complete() const { return complete_; }
  const json& state() const { return state_; }
  void save(json state) {
    state["request"] = request_;
    state_ = std::move(state);
    write_file_atomically(work() / "state.json", format_json(state_));
  }
  fs::path spills() const { return work() / "spills"; }
  void finish() const {
    std::error_code ignored;
    fs::remove_all(work(), ignored);
  }
  /// Where the inputs can have no plan: nothing is left to go on with.
  void discard() const {
    std::error_code ignored;
    finish();
    fs::remove_all(folder_ / "tiles", ignored);
    fs::remove(folder_, ignored);  // if it is empty
  }

 private:
  fs::path work() const { return folder_ / ".work"; }

  void take_over(bool overwrite) {
    std::error_code error;
    json request;
    if (fs::exists(folder_ / "index.json", error)) {
      const fs::path path = folder_ / "index.json";
      const json index = parse_json(read_whole_file(path, std::size_t{4} << 30), path.string());
      if (!index.is_object() || index.value("format", "") != "camber-tiles") {
        throw OutputError(folder_.string(), "found an index.json that is no plan of tiles");
      }
      request = index.value("request", json());
      complete_ = true;
    } else if (fs::exists(work() / "state.json", error)) {
      const fs::path path = work() / "state.json";
      state_ = parse_json(read_whole_file(path, std::size_t{4} << 30), path.string());
      request = state_.value("request", json());
    } else {
      return;  // stopped before anything was noted
    }
    const std::string other = difference(request_, request);
    if (other.empty()) {
      if (complete_) finish();
      return;
    }
    if (!overwrite) {
      throw UsageError(fmt::format(
          "{}: found a plan with another value of '{}' ({}), expected the same inputs and options, "
          "another folder, or --overwrite, which removes the plan and all its results",
          folder_.string(), other,
          other == "inputs" ? "other files" : request.value(other, json()).dump()));
    }
    fs::remove_all(folder_, error);
    if (error) throw OutputError(folder_.string(), error.message());
    complete_ = false;
    state_ = {};
  }

  fs::path folder_;
  json request_, state_;
  bool complete_ = false;
};

/// Collects bounds of the points of a file, and those of its parts.
class Bounds {
 public:
  /// @param parts  points of each; empty: one part
  explicit Bounds(std::vector<std::uint64_t> parts) : sizes_(std::move(parts)) { begin(); }

  void add(double x, double y, double z) {
    while (parts_.back().points == size() && next_ < sizes_.size()) begin();
    ++parts_.back().points;
    parts_.back().box.extend(Eigen::Vector2d(x, y));
    all_.extend(Eigen::Vector3d(x, y, z));
  }
  const Eigen::AlignedBox3d& all() const { return all_; }
  std::vector<TilePart> parts() const {
    if (sizes_.empty()) return {};
    std::vector<TilePart> out = parts_;
    for (TilePart& part : out) {
      if (part.points == 0) part.box = Eigen::AlignedBox2d(Eigen::Vector2d::Zero().eval());
    }
    return out;
  }

 private:
  std::uint64_t size() const { return sizes_.empty() ? UINT64_MAX : sizes_[next_ - 1]; }
  void begin() {
    parts_.emplace_back();
    ++next_;
  }

  std::vector<std::uint64_t> sizes_;
  std::size_t next_ = 0;
  std::vector<TilePart> parts_;
  Eigen::AlignedBox3d all_;
};

std::uint64_t size_of_file(const fs::path& path) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(path, error);
  if (error) throw InputError(path.string(), error.message());
  return size;
}

/// Takes the inputs for tiles: reads each once for bounds, count and hash.
std::vector<Tile> take_in_place(const std::vector<Input>& inputs, const fs::path& folder,
                                const TilePlanOptions& options, const Progress& progress) {
  std::vector<Tile> out;
  std::set<std::string> names;
  std::uint64_t done = 0, all = 0;
  for (const Input& input : inputs) all += input.points;
  for (const Input& input : inputs) {
    std::string name = input.path.stem().string();
    if (fs::path(name).extension() == ".copc") name = fs::path(name).stem().string();
    if (name.empty() || name[0] == '.' || !names.insert(name).second) {
      throw UsageError(input.path.string() + ": found two files named '" + name +
                       "', expected tiles whose names differ");
    }
    if (progress) {
      progress("read",
               static_cast<double>(done) / static_cast<double>(std::max<std::uint64_t>(all, 1)));
    }
    done += input.points;
    if (input.points == 0) continue;
    std::error_code error;
    if (fs::exists(tile_record_path(folder, name), error)) {
      const Tile known = read_tile_record(folder, name).tile;
      if (known.bytes == input.bytes) {
        out.push_back(known);
        continue;
      }
    }
    ReadOptions reading = reading_of(options);
    reading.attributes = std::vector<std::string>();
    const std::unique_ptr<PointSource> source = open_point_source(input.path, reading);
    Bounds bounds(las_chunks(*input.header.las));
    for (PointBatch batch; source->next(batch);) {
      throw_if_interrupted();
      for (std::size_t i = 0; i < batch.count; ++i) {
        bounds.add(batch.fields[0].get<double>(i), batch.fields[1].get<double>(i),
                   batch.fields[2].get<double>(i));
      }
    }
    TileRecord record;
    record.tile.name = name;
    record.tile.file = fs::absolute(input.path).lexically_normal();
    record.tile.points = input.points;
    record.tile.bytes = input.bytes;
    record.tile.hash = hash_file(input.path);
    record.tile.bounds = bounds.all();
    record.parts = bounds.parts();
    write_tile_record(folder, record);
    out.push_back(record.tile);
  }
  return out;
}

/// Puts coordinates of other inputs on the grid of the first one.
class Regrid {
 public:
  Regrid(const LasFile& from, const LasFile& to, std::string name) : name_(std::move(name)) {
    for (std::size_t a = 0; a < 3; ++a) {
      scale_[a] = from.scale[a] / to.scale[a];
      shift_[a] = (from.offset[a] - to.offset[a]) / to.scale[a];
      const bool whole =
          from.scale[a] == to.scale[a] && std::abs(shift_[a] - std::round(shift_[a])) < 1e-4;
      if (whole) shift_[a] = std::round(shift_[a]);
      rounds_ = rounds_ || !whole;
      same_ = same_ && whole && shift_[a] == 0.0;
    }
  }
  bool same() const { return same_; }
  bool rounds() const { return rounds_; }
  void apply(char* record, std::uint64_t point) const {
    for (std::size_t a = 0; a < 3; ++a) {
      std::int32_t value;
      std::memcpy(&value, record + 4 * a, 4);
      const double moved = std::round(static_cast<double>(value) * scale_[a] + shift_[a]);
      if (!(std::abs(moved) <= 2147483647.0)) {
        throw InputError(name_, fmt::format("point {} does not fit the grid of the first file's "
                                            "coordinates; expected files with nearer offsets",
                                            point));
      }
      value = static_cast<std::int32_t>(moved);
      std::memcpy(record + 4 * a, &value, 4);
    }
  }

 private:
  std::string name_;
  std::array<double, 3> scale_{}, shift_{};
  bool same_ = true, rounds_ = false;
};

/// m: such that tiles hold about 1e7 points, by the areas and counts of the headers.
double choose_side(const std::vector<Input>& inputs, double metres) {
  double area = 0.0, points = 0.0;
  Eigen::AlignedBox2d all;
  for (const Input& input : inputs) {
    const LasFile& las = *input.header.las;
    const double width = las.maximum[0] - las.minimum[0], depth = las.maximum[1] - las.minimum[1];
    if (!(width >= 0.0 && depth >= 0.0 && width < 1e9 && depth < 1e9)) continue;
    area += std::max(width * metres, 1.0) * std::max(depth * metres, 1.0);
    points += static_cast<double>(input.points);
  }
  double side = points > 0.0 ? std::sqrt(area * kPointsOfTile / points) : 1000.0;
  // Of small tiles more is read around them than they hold: then up to 2.25 times as many points,
  // which with what the tile before hands on (KeptParts) keeps what is read at 1.7 times what is
  // answered to 70 points a square metre, with 184 m around a tile.
  constexpr double kWide = 1500.0;
  side = std::clamp(kWide, side, 1.5 * side);
  const double step = std::pow(10.0, std::floor(std::log10(side)) - 1.0);
  return std::clamp(std::round(side / step) * step, 10.0, 10000.0);
}

void require_space(const fs::path& folder, double bytes) {
  std::error_code error;
  const fs::space_info space = fs::space(folder, error);
  if (!error && static_cast<double>(space.available) < bytes) {
    throw OutputError(
        folder.string(),
        fmt::format("{:.2f} GB are free on the disk, expected {:.2f} GB for the tiles "
                    "and for their points uncompressed on the way",
                    1e-9 * static_cast<double>(space.available), 1e-9 * bytes));
  }
}

/// Sorts the points of inputs into tiles.
class Tiler {
 public:
  Tiler(const std::vector<Input>& inputs, const fs::path& folder, const TilePlanOptions& options,
        double side, Workplace* work, const Progress& progress, const LogSink& warn)
      : inputs_(inputs),
        folder_(folder),
        options_(options),
        work_(*work),
        progress_(progress),
        warn_(warn),
        first_(*inputs.front().header.las),
        x_(first_.scale[0], first_.offset[0], side / options.metres, options.origin[0]),
        y_(first_.scale[1], first_.offset[1], side / options.metres, options.origin[1]),
        spills_(work->spills(), first_.record_length, options.memory) {
    constexpr double kLeastSteps = 100.0;
    for (const double scale : {first_.scale[0], first_.scale[1]}) {
      if (side / options.metres < kLeastSteps * scale) {
        throw UsageError(
            fmt::format("--tile: found {:g} m, expected at least {:g} m: a hundred "
                        "steps of the file's coordinates",
                        side, kLeastSteps * scale * options.metres));
      }
    }
    for (const Input& input : inputs) all_points_ += input.points;
  }

  std::vector<Tile> run() {
    std::size_t input = 0;
    std::uint64_t done = 0;
    bool streamed = false;
    begin(&input, &done, &streamed);
    if (!streamed) stream(input, done);
    return write_tiles();
  }

 private:
  void begin(std::size_t* input, std::uint64_t* done, bool* streamed);
  void stream(std::size_t input, std::uint64_t done);
  void save(std::size_t input, std::uint64_t done, bool streamed);
  std::vector<Tile> write_tiles();
  TileRecord write_tile(std::int64_t column, std::int64_t row);
  std::vector<int> order(const std::string& records, std::int64_t column, std::int64_t row) const;
  void report(const char* stage, double share) const {
    if (progress_) progress_(stage, share);
  }

  const std::vector<Input>& inputs_;
  const fs::path& folder_;
  const TilePlanOptions& options_;
  Workplace& work_;
  const Progress& progress_;
  const LogSink& warn_;
  const LasFile& first_;
  mutable TileAxis x_, y_;
  TileSpills spills_;
  std::uint64_t all_points_ = 0;
};

void Tiler::begin(std::size_t* input, std::uint64_t* done, bool* streamed) {
  const json& state = work_.state();
  if (state.is_object() && state.count("spills") > 0) {
    const auto sizes = state.at("spills").get<std::map<std::string, std::uint64_t>>();
    *streamed = state.value("streamed", false);
    // Once all points are there, files go away as their tiles are written.
    std::map<std::string, std::uint64_t> left;
    std::error_code error;
    for (const auto& [name, size] : sizes) {
      if (!*streamed || !fs::exists(tile_record_path(folder_, name), error)) left[name] = size;
    }
    if (spills_.resume(left)) {
      *input = state.value("input", std::size_t{0});
      *done = state.value("points", std::uint64_t{0});
      return;
    }
    *streamed = false;
  }
  spills_.clear();
  std::error_code error;
  fs::remove_all(folder_ / "tiles", error);
  fs::create_directories(folder_ / "tiles", error);
  std::uint64_t bytes = 0;
  for (const Input& one : inputs_) {
    // Compressed the tiles are about as large as LAZ is.
    bytes += one.points * first_.record_length +
             std::min<std::uint64_t>(one.bytes, one.points * first_.record_length / 2);
  }
  require_space(folder_, static_cast<double>(bytes));
}

void Tiler::save(std::size_t input, std::uint64_t done, bool streamed) {
  spills_.flush();
  work_.save(
      {{"input", input}, {"points", done}, {"streamed", streamed}, {"spills", spills_.sizes()}});
}

void Tiler::stream(std::size_t input, std::uint64_t done) {
  std::uint64_t before = 0;
  for (std::size_t k = 0; k < input; ++k) before += inputs_[k].points;
  for (; input < inputs_.size(); ++input, done = 0) {
    const Input& now = inputs_[input];
    const Regrid regrid(*now.header.las, first_, now.path.string());
    if (regrid.rounds() && warn_) {
      warn_(fmt::format("{}: its coordinates are rounded to the grid of {}", now.path.string(),
                        inputs_.front().path.string()));
    }
    const std::unique_ptr<PointSource> source = open_point_source(now.path, reading_of(options_));
    std::string record(first_.record_length, '\0');
    std::uint64_t place = 0;
    for (PointBatch batch; source->next(batch);) {
      throw_if_interrupted();
      bool full = false;
      for (std::size_t i = 0; i < batch.count; ++i, ++place) {
        if (place < done) continue;
        std::memcpy(record.data(), batch.records.data + i * batch.records.stride, record.size());
        if (!regrid.same()) regrid.apply(record.data(), place);
        std::int32_t x, y;
        std::memcpy(&x, record.data(), 4);
        std::memcpy(&y, record.data() + 4, 4);
        full = spills_.add(x_.tile_of(x), y_.tile_of(y), record.data()) || full;
      }
      if (full) save(input, place, false);
      report("read", static_cast<double>(before + place) / static_cast<double>(all_points_));
    }
    before += now.points;
  }
  save(inputs_.size(), 0, true);
}

/// In parts that are compact in plan, so that a neighbour's margin is few of them: strips by y,
/// these cut by x (Leutenegger, Lopez and Edgington, "STR", ICDE 1997). Within a part in Morton
/// order in plan, then by height, then by the records' bytes.
std::vector<int> Tiler::order(const std::string& records, std::int64_t column,
                              std::int64_t row) const {
  struct Item {
    std::uint32_t x, y;
    std::uint64_t code;
    std::int32_t z;
    std::int32_t index;
  };
  const std::size_t size = first_.record_length;
  const std::int64_t x0 = x_.edge(column), y0 = y_.edge(row);
  std::vector<Item> items(records.size() / size);
  Eigen::AlignedBox2d box;
  for (std::size_t i = 0; i < items.size(); ++i) {
    std::int32_t p[3];
    std::memcpy(p, records.data() + i * size, sizeof p);
    const auto x = static_cast<std::uint32_t>(p[0] - x0), y = static_cast<std::uint32_t>(p[1] - y0);
    items[i] = {x, y, morton_code(x, y), p[2], static_cast<std::int32_t>(i)};
    box.extend(Eigen::Vector2d(x * first_.scale[0], y * first_.scale[1]));
  }
  const auto before = [&](const auto& key, const Item& a, const Item& b) {
    if (key(a) != key(b)) return key(a) < key(b);
    if (a.code != b.code) return a.code < b.code;
    if (a.z != b.z) return a.z < b.z;
    return std::memcmp(records.data() + static_cast<std::size_t>(a.index) * size,
                       records.data() + static_cast<std::size_t>(b.index) * size, size) < 0;
  };
  const auto sort_by = [&](std::size_t from, std::size_t to, const auto& key) {
    std::sort(items.begin() + static_cast<std::ptrdiff_t>(from),
              items.begin() + static_cast<std::ptrdiff_t>(std::min(to, items.size())),
              [&](const Item& a, const Item& b) { return before(key, a, b); });
  };
  const std::size_t parts = (items.size() + kPartPoints - 1) / kPartPoints;
  if (parts > 1) {
    const Eigen::Vector2d extent = box.sizes().cwiseMax(1e-9);
    const double strips = std::sqrt(static_cast<double>(parts) * extent.y() / extent.x());
    const auto along = static_cast<std::size_t>(
        std::clamp(std::round(static_cast<double>(parts) / std::max(strips, 1e-9)), 1.0,
                   static_cast<double>(parts)));
    sort_by(0, items.size(), [](const Item& i) { return i.y; });
    for (std::size_t from = 0; from < items.size(); from += along * kPartPoints) {
      sort_by(from, from + along * kPartPoints, [](const Item& i) { return i.x; });
    }
  }
  for (std::size_t from = 0; from < items.size(); from += kPartPoints) {
    sort_by(from, from + kPartPoints, [](const Item& i) { return i.code; });
  }
  std::vector<int> out;
  out.reserve(items.size());
  for (const Item& item : items) out.push_back(item.index);
  return out;
}

TileRecord Tiler::write_tile(std::int64_t column, std::int64_t row) {
  const std::string name = TileSpills::name_of(column, row);
  std::string records = spills_.read(column, row);
  const std::size_t size = first_.record_length, count = records.size() / size;
  if (count > INT32_MAX) {
    throw NoAnswerError(
        fmt::format("{}: tile {} has {} points, expected less than 2^31: smaller "
                    "tiles (--tile)",
                    folder_.string(), name, count));
  }
  std::vector<int> sorted = order(records, column, row);
  std::vector<std::uint64_t> parts(count / kPartPoints, kPartPoints);
  if (count % kPartPoints != 0) parts.push_back(count % kPartPoints);
  Bounds bounds(parts);
  for (const int i : sorted) {
    std::int32_t p[3];
    std::memcpy(p, records.data() + static_cast<std::size_t>(i) * size, sizeof p);
    bounds.add(x_.coordinate(p[0]), y_.coordinate(p[1]), p[2] * first_.scale[2] + first_.offset[2]);
  }
  PointStreamHeader header = inputs_.front().header;
  // Bounds and counts of the header are those of another file, also where the counts are alike.
  const auto las = std::make_shared<LasFile>(first_);
  las->declared_count = UINT64_MAX;
  header.las = las;
  TileRecord out;
  out.tile.name = name;
  out.tile.file = fs::path("tiles") / (name + ".laz");
  out.tile.points = count;
  const std::unique_ptr<PointSource> rows =
      make_las_rows(header, std::move(records), std::move(sorted));
  const fs::path path = folder_ / out.tile.file;
  write_points(*rows, path);
  out.tile.bytes = size_of_file(path);
  out.tile.hash = hash_file(path);
  out.tile.bounds = bounds.all();
  out.tile.square = PlanBounds{x_.coordinate(x_.edge(column)), y_.coordinate(y_.edge(row)),
                               x_.coordinate(x_.edge(column + 1)), y_.coordinate(y_.edge(row + 1))};
  out.parts = bounds.parts();
  return out;
}

std::vector<Tile> Tiler::write_tiles() {
  // The names of all of them, also of those that an earlier run wrote.
  const auto sizes = work_.state().at("spills").get<std::map<std::string, std::uint64_t>>();
  if (sizes.size() > kMostTiles) {
    throw NoAnswerError(
        fmt::format("{}: {} tiles are too many: the points lie too far apart for "
                    "tiles of this size (--tile)",
                    folder_.string(), sizes.size()));
  }
  std::vector<std::pair<std::int64_t, std::int64_t>> tiles;
  for (const auto& [name, size] : sizes) {
    long long column = 0, row = 0;
    std::sscanf(name.c_str(), "%lld_%lld", &column, &row);
    tiles.emplace_back(row, column);
  }
  std::sort(tiles.begin(), tiles.end());
  std::vector<Tile> out;
  for (const auto& [row, column] : tiles) {
    throw_if_interrupted();
    report("write", static_cast<double>(out.size()) / static_cast<double>(tiles.size()));
    const std::string name = TileSpills::name_of(column, row);
    std::error_code error;
    if (fs::exists(tile_record_path(folder_, name), error)) {
      out.push_back(read_tile_record(folder_, name).tile);
    } else {
      const TileRecord record = write_tile(column, row);
      write_tile_record(folder_, record);
      out.push_back(record.tile);
    }
    spills_.remove(column, row);
  }
  return out;
}

TilePlan make_plan(const std::vector<Input>& opened, const fs::path& folder,
                   const TilePlanOptions& options, const json& request, Workplace* work,
                   const Progress& progress, const LogSink& warn) {
  TilePlan plan;
  plan.folder = folder;
  plan.in_place = options.in_place;
  plan.request = request;
  plan.crs = crs_in_words(opened.front().header);
  plan.metres = options.metres;
  plan.height_metres = options.height_metres;
  plan.keep_classes = options.keep_classes;
  if (options.in_place) {
    plan.tiles = take_in_place(opened, folder, options, progress);
  } else {
    const double side = options.side > 0.0 ? options.side : choose_side(opened, options.metres);
    plan.tiles = Tiler(opened, folder, options, side, work, progress, warn).run();
  }
  for (const Tile& tile : plan.tiles) {
    plan.points += tile.points;
    plan.bounds.extend(tile.bounds);
  }
  const double middle = 0.5 * (plan.bounds.min().z() + plan.bounds.max().z());
  plan.height_zero = std::round(middle * plan.height_metres / 64.0) * 64.0;
  GroundOptions ground = options.ground;
  ground.num_threads = options.num_threads;
  decide_ground(&plan, ground);
  return plan;
}

}  // namespace

void TilePlanOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (good) return;
    throw std::invalid_argument(fmt::format("{} = {}, expected {}", name, value, expected));
  };
  require(std::isfinite(side) && side >= 0.0 && side <= 1e6, "side", side, "0 to 1e6 m");
  for (const double o : origin) require(std::isfinite(o), "origin", o, "a coordinate");
  require(metres > 0.0 && std::isfinite(metres), "metres", metres, "more than 0");
  require(height_metres > 0.0 && std::isfinite(height_metres), "height_metres", height_metres,
          "more than 0");
  for (const int k : keep_classes) require(k >= 0 && k <= 255, "keep_classes", k, "0 to 255");
  ground.validate();
}

void take_units_of(const fs::path& file, const FindSystem& find, const LogSink& warn,
                   TilePlanOptions* options) {
  ReadOptions reading;
  reading.crs = options->crs;
  const std::unique_ptr<PointSource> source = open_point_source(file, reading);
  if (!source->header().crs) return;
  CoordinateSystem crs = *source->header().crs;
  complete_system(&crs, find);
  if (crs.horizontal.angle) {
    throw NoAnswerError(file.string() + ": the coordinates are longitude and latitude (" +
                        describe(crs) + "); tiles need coordinates on a map");
  }
  options->metres = crs.horizontal.metres;
  options->height_metres = crs.vertical.metres;
  if (!crs.metric() && warn) {
    warn(file.string() + ": the coordinates are not in metres (" + describe(crs) +
         "); lengths are converted, the tiles keep their coordinates");
  }
}

TilePlan plan_tiles(const std::vector<fs::path>& inputs, const fs::path& folder,
                    const TilePlanOptions& options, const Progress& progress, const LogSink& warn) {
  options.validate();
  if (inputs.empty()) throw std::invalid_argument("inputs: found none, expected at least one");
  std::vector<fs::path> sorted = inputs;
  std::sort(sorted.begin(), sorted.end());
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  const std::vector<Input> opened = open_inputs(sorted, options);
  std::uint64_t points = 0;
  for (const Input& input : opened) points += input.points;
  if (points == 0) throw NoAnswerError(sorted.front().string() + ": found no points");
  const json request = request_of(opened, options);
  Workplace work(folder, request, options.overwrite);
  if (work.complete()) return read_tile_plan(folder);
  if (!work.state().is_object()) work.save({});

  try {
    TilePlan plan = make_plan(opened, folder, options, request, &work, progress, warn);
    write_tile_plan(&plan);
  } catch (const InputError&) {
    work.discard();
    throw;
  } catch (const NoAnswerError&) {
    work.discard();
    throw;
  } catch (const UsageError&) {
    work.discard();
    throw;
  }
  work.finish();
  return read_tile_plan(folder);
}

}  // namespace camber
