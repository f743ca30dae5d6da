// Points of LAS and LAZ files, versions 1.0 to 1.5, point formats 0 to 10: the ASPRS
// specifications ("LAS Specification 1.4 - R15", 2019, its predecessors, and 1.5).

#include <algorithm>
#include <cmath>
#include <set>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/copc.h"
#include "camber/cloud/detail/laz/laz_reader.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/las_chunks.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

using detail::kLasAngleUnit;
using detail::las_extra_type;
using detail::las_point_format;
using detail::LasPointFormat;
using detail::load;

constexpr std::size_t kMostExtraBytes = 1 << 14;  // a point

/// What to take out of a record for one column.
struct Column {
  enum class Kind { kPlain, kCoordinate, kBits, kScaled } kind = Kind::kPlain;
  std::size_t offset = 0;
  ScalarType stored = ScalarType::kUint8;
  unsigned shift = 0, mask = 0xff;  // kBits, of one byte
  double scale = 1.0, shift_by = 0.0;
};

/// The attributes in the records of a LAS file.
class LasColumns {
 public:
  /// @throws InputError where the extra bytes do not fit their description, unless lenient.
  LasColumns(const LasFile& las, const ReadOptions& options, ReadReport* report)
      : las_(las), record_size_(las.record_length) {
    const LasPointFormat format = las_point_format(las.point_format);
    add_standard_columns(format, report);
    add_extra_columns(format, options.lenient, report);
    leave_out(options);
  }

  const std::vector<PointField>& fields() const { return fields_; }
  /// The layers of LAZ that hold them.
  std::uint32_t layers() const;

  /// Views into `data`, which holds `count` records, or into values that stay until the next call.
  void decode(const unsigned char* data, std::size_t count, PointBatch& batch) {
    batch.clear();
    batch.count = count;
    batch.records = {data, record_size_};
    for (std::size_t c = 0; c < columns_.size(); ++c) {
      const Column& column = columns_[c];
      const unsigned char* const first = data + column.offset;
      if (column.kind == Column::Kind::kPlain) {
        batch.fields.push_back({first, record_size_});
        continue;
      }
      std::vector<unsigned char>& values = values_[c];
      if (column.kind == Column::Kind::kBits) {
        values.resize(count);
        for (std::size_t i = 0; i < count; ++i) {
          values[i] =
              static_cast<unsigned char>(first[i * record_size_] >> column.shift & column.mask);
        }
        batch.fields.push_back({values.data(), 1});
        continue;
      }
      values.resize(count * sizeof(double));
      with_type(column.stored, [&](auto tag) {
        for (std::size_t i = 0; i < count; ++i) {
          const double value =
              static_cast<double>(load<decltype(tag)>(first + i * record_size_)) * column.scale +
              column.shift_by;
          std::memcpy(values.data() + i * sizeof(double), &value, sizeof(double));
        }
      });
      batch.fields.push_back({values.data(), sizeof(double)});
    }
  }

 private:
  void add_standard_columns(const LasPointFormat& format, ReadReport* report);
  void add_extra_columns(const LasPointFormat& format, bool lenient, ReadReport* report);
  void leave_out(const ReadOptions& options);
  void add(const std::string& name, ScalarType type, const Column& column);
  void add_plain(const std::string& name, ScalarType type, std::size_t offset);
  void add_bits(const std::string& name, std::size_t offset, unsigned shift, unsigned mask);

  const LasFile& las_;
  std::size_t record_size_ = 0;
  std::vector<PointField> fields_;
  std::vector<Column> columns_;
  std::vector<std::vector<unsigned char>> values_;
};

void LasColumns::add(const std::string& name, ScalarType type, const Column& column) {
  PointField field;
  field.name = name;
  field.type = type;
  fields_.push_back(field);
  columns_.push_back(column);
  values_.emplace_back();
}

void LasColumns::leave_out(const ReadOptions& options) {
  for (std::size_t f = fields_.size(); f-- > 3;) {
    if (options.wants(fields_[f].name)) continue;
    fields_.erase(fields_.begin() + static_cast<std::ptrdiff_t>(f));
    columns_.erase(columns_.begin() + static_cast<std::ptrdiff_t>(f));
    values_.pop_back();
  }
}

std::uint32_t LasColumns::layers() const {
  const LasPointFormat format = las_point_format(las_.point_format);
  const auto first = [](int offset) {
    return offset < 0 ? SIZE_MAX : static_cast<std::size_t>(offset);
  };
  std::uint32_t layers = laz::kWantZ;
  for (const Column& column : columns_) {
    const std::size_t at = column.offset;
    layers |= at < 12                        ? 0u
              : at < 14                      ? laz::kWantIntensity
              : at == 14                     ? 0u
              : at == 15                     ? laz::kWantFlags
              : at == 16                     ? laz::kWantClass
              : at == 17                     ? laz::kWantUser
              : at == 18                     ? laz::kWantAngle
              : at == 20                     ? laz::kWantSource
              : at == first(format.time)     ? laz::kWantTime
              : at >= format.size            ? laz::kWantBytes
              : at == first(format.infrared) ? laz::kWantInfrared
                                             : laz::kWantColor;
  }
  return layers;
}

void LasColumns::add_plain(const std::string& name, ScalarType type, std::size_t offset) {
  Column column;
  column.offset = offset;
  column.stored = type;
  add(name, type, column);
}

void LasColumns::add_bits(const std::string& name, std::size_t offset, unsigned shift,
                          unsigned mask) {
  Column column;
  column.kind = Column::Kind::kBits;
  column.offset = offset;
  column.shift = shift;
  column.mask = mask;
  add(name, ScalarType::kUint8, column);
}

void LasColumns::add_standard_columns(const LasPointFormat& format, ReadReport* report) {
  const char* const axes[] = {"x", "y", "z"};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Column column;
    column.kind = Column::Kind::kCoordinate;
    column.offset = 4 * axis;
    column.stored = ScalarType::kInt32;
    column.scale = las_.scale[axis];
    column.shift_by = las_.offset[axis];
    add(axes[axis], ScalarType::kFloat64, column);
  }
  add_plain("intensity", ScalarType::kUint16, 12);
  if (format.extended) {
    add_bits("return_number", 14, 0, 15);
    add_bits("number_of_returns", 14, 4, 15);
    add_bits("class_flags", 15, 0, 15);
    add_bits("scanner_channel", 15, 4, 3);
    add_bits("scan_direction_flag", 15, 6, 1);
    add_bits("edge_of_flight_line", 15, 7, 1);
    add_plain("classification", ScalarType::kUint8, 16);
    add_plain("user_data", ScalarType::kUint8, 17);
    Column angle;
    angle.kind = Column::Kind::kScaled;
    angle.offset = 18;
    angle.stored = ScalarType::kInt16;
    angle.scale = kLasAngleUnit;
    add("scan_angle", ScalarType::kFloat64, angle);
    add_plain("point_source_id", ScalarType::kUint16, 20);
  } else {
    add_bits("return_number", 14, 0, 7);
    add_bits("number_of_returns", 14, 3, 7);
    add_bits("scan_direction_flag", 14, 6, 1);
    add_bits("edge_of_flight_line", 14, 7, 1);
    add_bits("classification", 15, 0, 31);
    add_bits("class_flags", 15, 5, 7);
    add_plain("scan_angle_rank", ScalarType::kInt8, 16);
    add_plain("user_data", ScalarType::kUint8, 17);
    add_plain("point_source_id", ScalarType::kUint16, 18);
  }
  if (format.time >= 0) {
    add_plain("gps_time", ScalarType::kFloat64, static_cast<std::size_t>(format.time));
  }
  if (format.color >= 0) {
    const char* const channels[] = {"red", "green", "blue"};
    for (std::size_t c = 0; c < 3; ++c) {
      add_plain(channels[c], ScalarType::kUint16, static_cast<std::size_t>(format.color) + 2 * c);
    }
  }
  if (format.infrared >= 0) {
    add_plain("nir", ScalarType::kUint16, static_cast<std::size_t>(format.infrared));
  }
  if (format.wave >= 0) report->las_only.emplace_back("wave packets");
}

/// Columns of the extra bytes that are described.
void LasColumns::add_extra_columns(const LasPointFormat& format, bool lenient, ReadReport* report) {
  const std::size_t extra_bytes = record_size_ - format.size;
  if (extra_bytes > kMostExtraBytes) {
    las_.bytes->fail_at(105, "found " + std::to_string(extra_bytes) +
                                 " extra bytes a point, expected at most " +
                                 std::to_string(kMostExtraBytes));
  }
  const std::size_t described = las_.described_length();
  if (described > extra_bytes) {
    if (!lenient) {
      las_.bytes->fail_at(105, "found " + std::to_string(extra_bytes) +
                                   " extra bytes a point, expected the " +
                                   std::to_string(described) + " that are described");
    }
    report->notes.emplace_back("the extra bytes do not fit their description and are not read");
    return;
  }
  std::size_t unknown = extra_bytes - described;
  for (const LasExtraBytes& extra : las_.extra_bytes) unknown += extra.type == 0 ? extra.size : 0;
  if (unknown > 0) {
    report->las_only.push_back(std::to_string(unknown) +
                               " extra bytes a point without a description");
  }
  // An attribute that is described under the name of a standard one goes before it.
  for (const LasExtraBytes& extra : las_.extra_bytes) {
    for (std::size_t f = 3; f < fields_.size(); ++f) {
      if (fields_[f].name != extra.name) continue;
      fields_.erase(fields_.begin() + static_cast<std::ptrdiff_t>(f));
      columns_.erase(columns_.begin() + static_cast<std::ptrdiff_t>(f));
      values_.pop_back();
      break;
    }
  }
  std::set<std::string> names;
  for (const PointField& field : fields_) names.insert(field.name);
  std::size_t offset = format.size;
  for (const LasExtraBytes& extra : las_.extra_bytes) {
    for (std::size_t k = 0; k < extra.elements; ++k) {
      const ScalarType type = las_extra_type(extra.type);
      std::string name = extra.name.empty() ? "extra" : extra.name;
      if (extra.elements > 1) name += "_" + std::to_string(k);
      while (!names.insert(name).second) name += "_";
      Column column;
      column.offset = offset + k * size_of(type);
      column.stored = type;
      column.kind = extra.scaled() ? Column::Kind::kScaled : Column::Kind::kPlain;
      column.scale = extra.scale[k];
      column.shift_by = extra.offset[k];
      add(name, extra.scaled() ? ScalarType::kFloat64 : type, column);
    }
    offset += extra.size;
  }
}

/// What compresses the points, for the report.
std::string describe(const laz::LazLayout& layout) {
  const std::string chunks = layout.sequential
                                 ? "in one stream"
                                 : "in " + std::to_string(layout.chunks.size()) + " chunks";
  return ", LASzip " + layout.version + " compressor " +
         std::to_string(static_cast<int>(layout.compressor)) + " " + chunks;
}

class LasSource : public FormatSource {
 public:
  /// @param chunks  those to read; nullptr: all
  LasSource(std::unique_ptr<FileReader> file, const ReadOptions& options,
            const std::vector<std::size_t>* chunks = nullptr)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kLas;
    read_header(chunks);
  }

  bool next(PointBatch& batch) override {
    batch.clear();
    file_->consume(pending_);
    pending_ = 0;
    if (laz_) return next_of_laz(batch);
    if (left_ == 0) return false;
    const std::size_t record_size = header_.las->record_length;
    file_->fill(record_size);
    const std::size_t count = static_cast<std::size_t>(std::min<std::uint64_t>(
        std::min<std::uint64_t>(left_, kBatchSize), file_->available() / record_size));
    columns_->decode(file_->data(), count, batch);
    pending_ = count * record_size;
    left_ -= count;
    report_.points += count;
    return true;
  }

 private:
  void read_header(const std::vector<std::size_t>* chunks);
  void choose_chunks(LasFile* las, const std::vector<std::size_t>& chunks) const;
  void choose_nodes(LasFile* las);
  void read_comments(const LasRecord& record);
  bool next_of_laz(PointBatch& batch);

  std::unique_ptr<laz::LazReader> laz_;
  std::uint64_t left_ = 0;
  std::size_t pending_ = 0;
  std::ptrdiff_t noted_ = 0;  // remarks of the LAZ reader that are in the report
  std::unique_ptr<LasColumns> columns_;
};

void LasSource::choose_chunks(LasFile* las, const std::vector<std::size_t>& chunks) const {
  const std::size_t count = las_chunks(*las).size();
  laz::LazLayout layout = las->laz ? *las->laz : laz::LazLayout();
  std::vector<laz::LazChunk> chosen;
  las->points = 0;
  for (const std::size_t chunk : chunks) {
    if (chunk >= count) {
      throw InputError(file_->name(), "found " + std::to_string(count) +
                                          " chunks of points, expected one with number " +
                                          std::to_string(chunk));
    }
    chosen.push_back(layout.chunks[chunk]);
    las->points += chosen.back().points;
  }
  layout.chunks = std::move(chosen);
  las->laz = std::make_shared<const laz::LazLayout>(std::move(layout));
}

/// Nodes by bounds and resolution.
void LasSource::choose_nodes(LasFile* las) {
  laz::CopcQuery query;
  query.resolution = options_.resolution;
  query.bounds = options_.bounds;
  laz::select_nodes(las, query, options_.lenient, &report_.notes);
}

void LasSource::read_header(const std::vector<std::size_t>* chunks) {
  const auto las =
      std::make_shared<LasFile>(read_las_file(file_->bytes(), options_.lenient, &report_.notes));
  const bool copc = laz::is_copc(*las);
  if (options_.resolution > 0.0 && !copc) {
    throw InputError(file_->name(), "found a file without levels of detail, expected COPC");
  }
  // Before some are chosen: what is not asked for is not missing.
  report_.drop("truncated", las->declared_count - las->points);
  if (copc && (options_.resolution > 0.0 || options_.bounds)) choose_nodes(las.get());
  if (chunks) choose_chunks(las.get(), *chunks);
  left_ = las->points;
  report_.encoding = "version 1." + std::to_string(las->minor) + ", point format " +
                     std::to_string(las->point_format);
  report_.declared = las->declared_count;
  header_.las = las;
  header_.records = !options_.attributes;
  for (const LasRecord& record : las->records) {
    if (record.user_id == "Camber" && record.record_id == 1) read_comments(record);
  }
  const auto vector = [](const std::array<double, 3>& v) {
    return Eigen::Vector3d(v[0], v[1], v[2]);
  };
  header_.grid = PointGrid{vector(las->scale), vector(las->offset)};
  // How many points of damaged LAZ are whole is known at the end.
  if (!las->laz || !options_.lenient) header_.count = left_;
  take_crs(las->crs);
  columns_ = std::make_unique<LasColumns>(*las, options_, &report_);
  header_.fields = columns_->fields();
  if (las->laz) {
    laz::LazReadOptions options;
    options.lenient = options_.lenient;
    options.num_threads = options_.num_threads;
    if (options_.attributes) options.wanted = columns_->layers();
    constexpr std::uint64_t kPointsOfByte = 8;  // more than of any survey
    header_.most_reserved = kPointsOfByte * (las->points_end - las->points_start);
    laz_ = std::make_unique<laz::LazReader>(*las, options);
    report_.format = CloudFormat::kLaz;
    report_.encoding += describe(*las->laz);
    return;
  }
  file_->skip(las->points_start);
}

bool LasSource::next_of_laz(PointBatch& batch) {
  const unsigned char* records = nullptr;
  const std::size_t count = laz_->next(&records, kBatchSize);
  if (count == 0) {
    if (left_ > 0) report_.drop("damaged", left_);
    left_ = 0;
    report_.notes.insert(report_.notes.end(), laz_->notes().begin() + noted_, laz_->notes().end());
    noted_ = static_cast<std::ptrdiff_t>(laz_->notes().size());
    return false;
  }
  columns_->decode(records, count, batch);
  if (!header_.records) batch.records = {};
  left_ -= count;
  report_.points += count;
  return true;
}

/// The comments that Camber puts into a record of its own.
void LasSource::read_comments(const LasRecord& record) {
  constexpr std::uint64_t kMost = 1 << 16;
  const std::string content =
      header_.las->bytes->read(record.content, std::min(record.length, kMost));
  std::string_view text = content;
  while (!text.empty()) {
    const std::size_t line = std::min(text.find('\n'), text.size());
    read_comment(text.substr(0, line));
    text.remove_prefix(std::min(line + 1, text.size()));
  }
}

class LasRows : public PointSource {
 public:
  LasRows(const PointStreamHeader& header, std::string records, std::vector<int> order)
      : records_(std::move(records)),
        order_(std::move(order)),
        columns_(*header.las, lenient_options(), &report_) {
    header_ = header;
    header_.fields = columns_.fields();
    header_.count = order_.size();
    report_ = {};
    report_.format = CloudFormat::kLas;
    report_.declared = order_.size();
  }

  bool next(PointBatch& batch) override {
    const std::size_t size = header_.las->record_length;
    const std::size_t count = std::min(kBatchSize, order_.size() - done_);
    rows_.clear();
    for (std::size_t i = 0; i < count; ++i) {
      rows_.append(records_, static_cast<std::size_t>(order_[done_ + i]) * size, size);
    }
    columns_.decode(reinterpret_cast<const unsigned char*>(rows_.data()), count, batch);
    done_ += count;
    report_.points = done_;
    return count > 0;
  }

 private:
  static ReadOptions lenient_options() {
    ReadOptions options;
    options.lenient = true;
    return options;
  }

  std::string records_, rows_;
  std::vector<int> order_;
  LasColumns columns_;
  std::size_t done_ = 0;
};

}  // namespace

std::unique_ptr<PointSource> open_las(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<LasSource>(std::move(file), options);
}

std::vector<std::uint64_t> las_chunks(const LasFile& las) {
  std::vector<std::uint64_t> out;
  if (!las.laz || las.laz->sequential) return out;
  std::uint64_t points = 0;
  for (const laz::LazChunk& chunk : las.laz->chunks) {
    out.push_back(chunk.points);
    points += chunk.points;
  }
  return points == las.points ? out : std::vector<std::uint64_t>();
}

std::unique_ptr<PointSource> open_las_chunks(const std::filesystem::path& path,
                                             const ReadOptions& options,
                                             const std::vector<std::size_t>& chunks) {
  return std::make_unique<LasSource>(std::make_unique<FileReader>(path), options, &chunks);
}

std::unique_ptr<PointSource> make_las_rows(const PointStreamHeader& header, std::string records,
                                           std::vector<int> order) {
  return std::make_unique<LasRows>(header, std::move(records), std::move(order));
}

}  // namespace camber
