// KITTI's velodyne scans: little-endian float32 x, y, z, reflectance and nothing else; on reading
// also the like of other projects with more or fewer columns (nuScenes: a ring).

#include <array>
#include <cmath>
#include <set>

#include "camber/cloud/detail/bin_layout.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/las_names.h"
#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

constexpr float kLargest = 1e6f;  // m; no header distinguishes a scan from any other file

class KittiBinSource : public FormatSource {
 public:
  KittiBinSource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kKittiBin;
    take_crs({});
    report_.encoding = "binary little endian";
    const std::vector<std::string> columns = choose_columns();
    record_ = columns.size() * sizeof(float);
    const std::uint64_t count = file_->size() / record_;
    if (file_->size() % record_ != 0) report_.drop("truncated", 1);
    header_.count = count;
    std::vector<RecordReader::Field> places;
    for (std::size_t c = 0; c < columns.size(); ++c) {
      if (columns[c] == "_") continue;
      PointField field;
      field.name = columns[c];
      header_.fields.push_back(field);
      RecordReader::Field place;
      place.offset = c * sizeof(float);
      places.push_back(place);
    }
    check_fields("--columns");
    position_ = find_roles(header_.fields).position;
    for (const RecordReader::Field& place : places) offsets_.push_back(place.offset);
    records_ = RecordReader(record_, std::move(places), count, false);
  }

  bool next(PointBatch& batch) override {
    const std::uint64_t first = report_.points;
    const bool more = records_.next(*file_, batch);
    report_.points += batch.count;
    for (std::size_t i = 0; i < batch.count && !options_.lenient; ++i) {
      for (const int field : position_) {
        if (field < 0) continue;
        const std::size_t f = static_cast<std::size_t>(field);
        const float value = batch.fields[f].get<float>(i);
        if (std::abs(value) < kLargest) continue;
        file_->fail_at((first + i) * record_ + offsets_[f],
                       "found the coordinate " + std::to_string(value) +
                           ", expected one below 1000 km (is this a KITTI scan?)");
      }
    }
    return more;
  }

 private:
  /// Those of the options, else those that the numbers show.
  std::vector<std::string> choose_columns() {
    if (options_.columns.empty()) {
      const detail::BinLayout layout = detail::find_bin_layout(*file_->bytes(), options_.lenient);
      if (!layout.kitti) {
        std::string names;
        for (const std::string& name : layout.columns) names += " " + name;
        report_.notes.push_back("its points have " + std::to_string(layout.columns.size()) +
                                " floats, not KITTI's four, and are read as" + names);
      }
      return layout.columns;
    }
    std::set<std::string> names;
    for (const std::string& name : options_.columns) {
      if (name != "_" && !names.insert(name).second) {
        throw InputError(file_->name(), "found the column '" + name +
                                            "' twice in --columns, expected different names");
      }
    }
    const std::size_t record = options_.columns.size() * sizeof(float);
    if (file_->size() % record != 0 && !options_.lenient) {
      throw InputError(file_->name(), "found " + std::to_string(file_->size()) +
                                          " bytes, expected a multiple of " +
                                          std::to_string(record) + ", the columns' float32");
    }
    return options_.columns;
  }

  RecordReader records_;
  std::size_t record_ = 0;            // bytes
  std::vector<std::size_t> offsets_;  // of the fields in a record
  std::array<int, 3> position_{-1, -1, -1};
};

class KittiBinSink : public PointSink {
 public:
  KittiBinSink(std::ostream& out, const PointStreamHeader& header) : out_(out), header_(header) {
    const FieldRoles roles = find_roles(header.fields);
    for (std::size_t axis = 0; axis < 3; ++axis) fields_[axis] = roles.position[axis];
    // An exact name goes before those of other programs, and those before "reflectance".
    for (const int turn : {0, 1, 2}) {
      for (const int field : roles.others) {
        const std::string& name = header.fields[static_cast<std::size_t>(field)].name;
        const bool good = turn == 0   ? name == "intensity"
                          : turn == 1 ? las_attribute(name) == "intensity"
                                      : lower_case(name) == "reflectance";
        if (fields_[3] < 0 && good) fields_[3] = field;
      }
    }
  }

  void write(const PointBatch& batch) override {
    if (!started_) choose_origin(batch);
    values_.resize(4 * batch.count);
    for (std::size_t c = 0; c < 4; ++c) {
      const int field = fields_[c];
      for (std::size_t i = 0; i < batch.count; ++i) {
        values_[4 * i + c] =
            field < 0
                ? 0.0f
                : static_cast<float>(batch.fields[static_cast<std::size_t>(field)].number(
                                         header_.fields[static_cast<std::size_t>(field)].type, i) -
                                     origin_[c]);
        if (c < 3 && std::abs(values_[4 * i + c]) >= kFar) far_ = true;
      }
    }
    require_readable(batch);
    count_ += batch.count;
    out_.write(reinterpret_cast<const char*>(values_.data()),
               static_cast<std::streamsize>(values_.size() * sizeof(float)));
  }

  void finish() override {}

  std::vector<std::string> notes() const override {
    std::vector<std::string> notes;
    if (origin_[0] != 0.0 || origin_[1] != 0.0 || origin_[2] != 0.0) {
      std::string place;
      for (std::size_t c = 0; c < 3; ++c) {
        place += ' ';
        append_number(place, origin_[c]);
      }
      notes.push_back("KITTI .bin holds floats: the coordinates are written relative to" + place +
                      ", which the file does not record");
    }
    if (far_) {
      notes.emplace_back(
          "some coordinates are beyond 8 km, where a float is good to half a millimetre or worse");
    }
    return notes;
  }

 private:
  static constexpr float kFar = 8192.0f;  // m; a float is good to 0.5 mm below

  /// What the reader refuses is not written.
  void require_readable(const PointBatch& batch) const {
    for (std::size_t i = 0; i < batch.count; ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        if (std::abs(values_[4 * i + c]) < kLargest) continue;
        const std::size_t f = static_cast<std::size_t>(fields_[c]);
        std::string shown_value;
        append_number(shown_value, batch.fields[f].number(header_.fields[f].type, i));
        throw std::invalid_argument(
            "point " + std::to_string(count_ + i) + " has the coordinate " + shown_value +
            ", expected a finite one within 1000 km of the first for KITTI .bin (--lenient drops "
            "points that are not finite)");
      }
    }
  }

  /// Coordinates of a map do not fit into floats: the round part of the first point is taken away
  /// and named in the notes.
  void choose_origin(const PointBatch& batch) {
    if (batch.count == 0) return;
    started_ = true;
    bool far = false;
    std::array<double, 3> first{0.0, 0.0, 0.0};
    for (std::size_t c = 0; c < 3; ++c) {
      if (fields_[c] < 0) continue;
      const std::size_t f = static_cast<std::size_t>(fields_[c]);
      for (std::size_t i = 0; i < batch.count; ++i) {
        const double x = batch.fields[f].number(header_.fields[f].type, i);
        if (!std::isfinite(x)) continue;
        first[c] = x;
        break;
      }
      far = far || std::abs(first[c]) >= kFar;
    }
    if (!far) return;
    for (std::size_t c = 0; c < 3; ++c) {
      if (std::abs(first[c]) < 1e12) origin_[c] = std::round(first[c] / 1000.0) * 1000.0;
    }
  }

  std::ostream& out_;
  PointStreamHeader header_;
  std::array<double, 4> origin_{0.0, 0.0, 0.0, 0.0};
  bool started_ = false, far_ = false;
  std::uint64_t count_ = 0;
  std::array<int, 4> fields_{-1, -1, -1, -1};
  std::vector<float> values_;
};

}  // namespace

std::unique_ptr<PointSource> open_kitti_bin(std::unique_ptr<FileReader> file,
                                            const ReadOptions& options) {
  return std::make_unique<KittiBinSource>(std::move(file), options);
}

std::unique_ptr<PointSink> make_kitti_bin_sink(std::ostream& out, const PointStreamHeader& header) {
  return std::make_unique<KittiBinSink>(out, header);
}

}  // namespace camber
