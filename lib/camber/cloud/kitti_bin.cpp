// KITTI's velodyne scans: little-endian float32 x, y, z, reflectance and nothing else.

#include <cmath>

#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

constexpr std::size_t kRecord = 16;  // bytes
constexpr float kLargest = 1e6f;     // m; no header distinguishes a scan from any other file

class KittiBinSource : public FormatSource {
 public:
  KittiBinSource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kKittiBin;
    take_crs({});
    report_.encoding = "binary little endian";
    const std::uint64_t count = file_->size() / kRecord;
    if (file_->size() % kRecord != 0) {
      if (!options.lenient) {
        throw InputError(file_->name(), "found " + std::to_string(file_->size()) +
                                            " bytes, expected a multiple of 16 (float32 x y z "
                                            "reflectance)");
      }
      report_.drop("truncated", 1);
    }
    header_.count = count;
    std::vector<RecordReader::Field> places;
    for (const char* const name : {"x", "y", "z", "intensity"}) {
      PointField field;
      field.name = name;
      header_.fields.push_back(field);
      RecordReader::Field place;
      place.offset = 4 * places.size();
      places.push_back(place);
    }
    records_ = RecordReader(kRecord, std::move(places), count, false);
  }

  bool next(PointBatch& batch) override {
    const std::uint64_t first = report_.points;
    const bool more = records_.next(*file_, batch);
    report_.points += batch.count;
    for (std::size_t i = 0; i < batch.count && !options_.lenient; ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float value = batch.fields[axis].get<float>(i);
        if (std::abs(value) < kLargest) continue;
        file_->fail_at((first + i) * kRecord + 4 * axis,
                       "found the coordinate " + std::to_string(value) +
                           ", expected one below 1000 km (is this a KITTI scan?)");
      }
    }
    return more;
  }

 private:
  RecordReader records_;
};

class KittiBinSink : public PointSink {
 public:
  KittiBinSink(std::ostream& out, const PointStreamHeader& header) : out_(out), header_(header) {
    const FieldRoles roles = find_roles(header.fields);
    for (std::size_t axis = 0; axis < 3; ++axis) fields_[axis] = roles.position[axis];
    for (const char* const name : {"intensity", "reflectance", "scalar_intensity", "Intensity"}) {
      for (const int field : roles.others) {
        if (fields_[3] < 0 && header.fields[static_cast<std::size_t>(field)].name == name) {
          fields_[3] = field;
        }
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
