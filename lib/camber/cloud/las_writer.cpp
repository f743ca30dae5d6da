// LAS files, versions 1.2 and 1.4, point formats 0 to 3 and 6 to 8: the ASPRS specifications
// ("LAS Specification 1.4 - R15", 2019, and its predecessors).

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/laz_writer.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/las_names.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

using detail::kLasAngleUnit;
using detail::kLasRecordHeader;
using detail::las_point_format;
using detail::las_record;
using detail::LasPointFormat;
using detail::store;

/// The step of a grid, m, unless the coordinates leave no room for it: +-214 km.
constexpr double kStep = 1e-4;
constexpr double kMostSteps = std::numeric_limits<std::int32_t>::max();

/// Coordinates within it may be degrees: a square of 111 km at most, m or degrees.
constexpr double kSmallExtent = 1.0;

constexpr double kWeek = 604800.0;  // s

constexpr double kEarthRadius = 6378137.0;  // m, of WGS 84
constexpr double kEquator = 2.0 * M_PI * kEarthRadius;

/// A unit of an angle on the ground at the equator, m.
double metres_on_ground(const CoordinateUnit& angle) {
  const double radians =
      angle.name == "radian" ? 1.0 : M_PI / (angle.name == "grad" ? 200.0 : 180.0);
  return kEarthRadius * radians;
}

class LasSink : public PointSink {
 public:
  LasSink(std::ostream& out, const PointStreamHeader& header, LasPoints points)
      : out_(out), header_(header), compress_(points == LasPoints::kCompressed) {
    const FieldRoles roles = find_roles(header.fields);
    position_ = roles.position;
    color_ = roles.color;
    packed_ = roles.packed_color;
    std::vector<bool> standard(header.fields.size(), false);
    // An exact name goes before those of other programs.
    const auto find = [&](std::string_view name) {
      for (const bool exact : {true, false}) {
        for (std::size_t f = 0; f < header.fields.size(); ++f) {
          const std::string& own = header.fields[f].name;
          if (exact ? own != name : las_attribute(own) != name) continue;
          standard[f] = true;
          return static_cast<int>(f);
        }
      }
      return -1;
    };
    intensity_ = find("intensity");
    return_number_ = find("return_number");
    number_of_returns_ = find("number_of_returns");
    class_flags_ = find("class_flags");
    channel_ = find("scanner_channel");
    direction_ = find("scan_direction_flag");
    edge_ = find("edge_of_flight_line");
    classification_ = find("classification");
    user_data_ = find("user_data");
    angle_ = find("scan_angle");
    angle_rank_ = find("scan_angle_rank");
    source_id_ = find("point_source_id");
    time_ = find("gps_time");
    infrared_ = find("nir");
    flags_ = {find("synthetic"), find("key_point"), find("withheld"), find("overlap")};
    // An intensity in other units is kept as it is, beside the standard field.
    if (intensity_ >= 0 && is_float(type(intensity_)) &&
        !header.fields[static_cast<std::size_t>(intensity_)].fits_uint16) {
      standard[static_cast<std::size_t>(intensity_)] = false;
      other_intensity_ = header.fields[static_cast<std::size_t>(intensity_)].name;
      intensity_ = -1;
    }
    for (const int f : position_) mark(standard, f);
    for (const int f : color_) mark(standard, f);
    full_color_ = full_color_by_type(header.fields);
    if (!full_color_) full_color_ = header.full_color;
    mark(standard, packed_);
    const bool has_color = color_[0] >= 0 || packed_ >= 0;
    // The older formats are for what comes from them: their classes end at 31, their angles are
    // whole.
    const bool old = angle_rank_ >= 0 && !is_float(type(angle_rank_)) &&
                     header.fields[static_cast<std::size_t>(angle_rank_)].name == "scan_angle_rank";
    const bool extended = points == LasPoints::kExtended || angle_ >= 0 || channel_ >= 0 ||
                          infrared_ >= 0 || flags_[3] >= 0 || (classification_ >= 0 && !old);
    format_id_ = extended ? (infrared_ >= 0 ? 8
                             : has_color    ? 7
                                            : 6)
                          : (time_ >= 0 ? 1 : 0) + (has_color ? 2 : 0);
    format_ = las_point_format(format_id_);
    record_size_ = format_.size;
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      if (standard[f]) continue;
      extras_.push_back(static_cast<int>(f));
      record_size_ += size_of(header.fields[f].type);
    }
    if (record_size_ > UINT16_MAX || extras_.size() > 341) {
      throw std::invalid_argument("the cloud has " + std::to_string(extras_.size()) +
                                  " further attributes, expected fewer for LAS");
    }
    minor_ = extended || !extras_.empty() || header.count.value_or(UINT64_MAX) > UINT32_MAX ? 4 : 2;
    start_ = out.tellp();
    if (header.grid) {
      scale_ = header.grid->scale;
      offset_ = header.grid->offset;
      grid_set_ = true;
    }
    write_head();
    if (compress_) laz_ = std::make_unique<laz::LazWriter>(out_, start_, format_id_, record_size_);
  }

  void write(const PointBatch& batch) override {
    if (!grid_set_) choose_grid(batch);
    if (!full_color_) {
      GreatestColor greatest(header_.fields);
      greatest.add(batch);
      full_color_ = greatest.full_color();
    }
    text_.assign(batch.count * record_size_, '\0');
    for (std::size_t i = 0; i < batch.count; ++i) pack(batch, i, i * record_size_);
    if (laz_) {
      laz_->write(text_.data(), batch.count);
    } else {
      out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
    }
    count_ += batch.count;
  }

  void finish() override {
    if (laz_) laz_->finish();
    const std::ostream::pos_type end = out_.tellp();
    out_.seekp(start_);
    write_head();
    out_.seekp(end);
  }

  std::vector<std::string> notes() const override {
    std::vector<std::string> notes;
    if (!other_intensity_.empty() && count_ > 0) {
      notes.push_back("the intensities '" + other_intensity_ +
                      "' are not all whole numbers from 0 to 65535, as LAS's own field holds: they "
                      "are extra bytes, and that field is 0");
    }
    for (const auto& [name, count] : cut_) {
      notes.push_back("of the attribute '" + name + "' " + std::to_string(count) +
                      " values are not as LAS's own field holds them and are rounded or cut");
    }
    if (header_.grid || count_ == 0) return notes;
    const auto rounded = [](const char* what, double step) {
      std::string note = std::string("the ") + what + " are rounded to multiples of ";
      append_number(note, step);
      return note;
    };
    const double step = scale_.head<2>().maxCoeff();
    if (angles_) {
      constexpr double kCoarse = 1e-3;  // m
      const double metres = step * metres_on_ground(header_.crs->horizontal);
      if (metres > kCoarse) {
        std::string note = rounded("longitudes and latitudes", step) + " (";
        append_number(note, static_cast<float>(std::round(metres * 1e4) / 1e4));
        notes.push_back(note + " m on the ground), the finest that LAS has for their extent");
      }
    } else if (!header_.crs && (high_ - low_).head<2>().maxCoeff() < kSmallExtent) {
      notes.push_back(rounded("coordinates, whose unit is not known,", step) +
                      ", metres on the ground if they are degrees: then state their system");
    }
    return notes;
  }

 private:
  static void mark(std::vector<bool>& standard, int field) {
    if (field >= 0) standard[static_cast<std::size_t>(field)] = true;
  }
  ScalarType type(int field) const { return header_.fields[static_cast<std::size_t>(field)].type; }
  double value(const PointBatch& batch, int field, std::size_t i, double otherwise = 0.0) const {
    return field < 0 ? otherwise
                     : batch.fields[static_cast<std::size_t>(field)].number(type(field), i);
  }
  double clamped(const PointBatch& batch, int field, std::size_t i, double largest,
                 double otherwise = 0.0) {
    const double v = value(batch, field, i, otherwise);
    const double kept = v > 0.0 ? std::min(std::floor(v + 0.5), largest) : 0.0;
    if (kept != v && field >= 0) ++cut_[header_.fields[static_cast<std::size_t>(field)].name];
    return kept;
  }

  /// Those of one attribute, and those that have attributes of their own.
  unsigned class_flags(const PointBatch& batch, std::size_t i) {
    unsigned flags =
        static_cast<unsigned>(clamped(batch, class_flags_, i, format_.extended ? 15.0 : 7.0));
    for (std::size_t bit = 0; bit < flags_.size(); ++bit) {
      if (clamped(batch, flags_[bit], i, 1.0) > 0.0) flags |= 1u << bit;
    }
    return flags;
  }

  /// As fine as the step in metres and no finer than the extent allows: 1, 2 or 5 times a power of
  /// ten. Where the extent is not known, for the full circle.
  void choose_angle_grid(Eigen::Index axis) {
    const double metres = metres_on_ground(header_.crs->horizontal);
    const double finest = std::pow(10.0, std::round(std::log10(kStep / metres)));
    const bool known = header_.bounds && header_.bounds->min()[axis] <= header_.bounds->max()[axis];
    const double low = known ? header_.bounds->min()[axis] : -kEquator / metres;
    const double high = known ? header_.bounds->max()[axis] : kEquator / metres;
    for (double decade = finest;; decade *= 10.0) {
      for (const double step : {decade, 2.0 * decade, 5.0 * decade}) {
        const double round = 1e8 * step;  // of the offset
        offset_[axis] = std::round(0.5 * (low + high) / round) * round;
        scale_[axis] = step;
        const double reach = std::max(high - offset_[axis], offset_[axis] - low);
        if (!(reach > kMostSteps * step)) return;
      }
    }
  }

  void choose_grid(const PointBatch& batch) {
    grid_set_ = true;
    scale_ = Eigen::Vector3d::Constant(kStep);
    angles_ = header_.crs && header_.crs->horizontal.angle;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Eigen::Index a = static_cast<Eigen::Index>(axis);
      if (angles_ && axis < 2) {
        choose_angle_grid(a);
        continue;
      }
      if (header_.origin) {
        offset_[a] = (*header_.origin)[a];
        continue;
      }
      const double first = batch.count > 0 ? value(batch, position_[axis], 0) : 0.0;
      offset_[a] =
          std::abs(first) > 1e5 && std::isfinite(first) ? std::round(first / 1e3) * 1e3 : 0.0;
      offset_steps_[axis] = std::round(offset_[a] / scale_[a]);
    }
  }

  void pack(const PointBatch& batch, std::size_t i, std::size_t at) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Eigen::Index a = static_cast<Eigen::Index>(axis);
      const double x = value(batch, position_[axis], i);
      // A coordinate half-way between two steps is rounded alike, whichever offset a file has.
      const double steps = offset_steps_[axis] ? std::round(x / scale_[a]) - *offset_steps_[axis]
                                               : std::round((x - offset_[a]) / scale_[a]);
      if (!(std::abs(steps) <= kMostSteps)) {
        std::string shown_value;
        append_number(shown_value, x);
        throw std::invalid_argument(
            "point " + std::to_string(count_ + i) + " has the coordinate " + shown_value +
            ", expected a finite one" +
            (angles_ && axis < 2 ? " within a circle" : " within 214 km of the others") +
            " for LAS (--lenient drops points that are not finite)");
      }
      store(text_, at + 4 * axis, static_cast<std::int32_t>(steps));
      const double kept = steps * scale_[a] + offset_[a];
      if (count_ + i == 0 || kept < low_[a]) low_[a] = kept;
      if (count_ + i == 0 || kept > high_[a]) high_[a] = kept;
    }
    store(text_, at + 12, static_cast<std::uint16_t>(clamped(batch, intensity_, i, 65535.0)));
    const unsigned most_returns = format_.extended ? 15 : 7;
    const unsigned number =
        static_cast<unsigned>(clamped(batch, return_number_, i, most_returns, 1.0));
    const unsigned returns =
        static_cast<unsigned>(clamped(batch, number_of_returns_, i, most_returns, 1.0));
    if (number > 0) ++by_return_[number - 1];  // 0 is no return
    const unsigned direction = static_cast<unsigned>(clamped(batch, direction_, i, 1.0));
    const unsigned edge = static_cast<unsigned>(clamped(batch, edge_, i, 1.0));
    if (format_.extended) {
      text_[at + 14] = static_cast<char>(number | returns << 4);
      text_[at + 15] = static_cast<char>(
          class_flags(batch, i) | static_cast<unsigned>(clamped(batch, channel_, i, 3.0)) << 4 |
          direction << 6 | edge << 7);
      text_[at + 16] =
          static_cast<char>(static_cast<std::uint8_t>(clamped(batch, classification_, i, 255.0)));
      text_[at + 17] =
          static_cast<char>(static_cast<std::uint8_t>(clamped(batch, user_data_, i, 255.0)));
      const double degrees = angle_ >= 0 ? value(batch, angle_, i) : value(batch, angle_rank_, i);
      const double units = std::isfinite(degrees)
                               ? std::clamp(std::round(degrees / kLasAngleUnit), -30000.0, 30000.0)
                               : 0.0;
      store(text_, at + 18, static_cast<std::int16_t>(units));
      store(text_, at + 20, static_cast<std::uint16_t>(clamped(batch, source_id_, i, 65535.0)));
    } else {
      text_[at + 14] = static_cast<char>(number | returns << 3 | direction << 6 | edge << 7);
      text_[at + 15] =
          static_cast<char>(static_cast<unsigned>(clamped(batch, classification_, i, 31.0)) |
                            class_flags(batch, i) << 5);
      const double rank = value(batch, angle_rank_, i);
      text_[at + 16] = static_cast<char>(static_cast<std::int8_t>(
          std::isfinite(rank) ? std::clamp(std::round(rank), -128.0, 127.0) : 0.0));
      text_[at + 17] =
          static_cast<char>(static_cast<std::uint8_t>(clamped(batch, user_data_, i, 255.0)));
      store(text_, at + 18, static_cast<std::uint16_t>(clamped(batch, source_id_, i, 65535.0)));
    }
    if (format_.time >= 0) {
      const double time = value(batch, time_, i);
      beyond_week_ = beyond_week_ || time < 0.0 || time > kWeek;
      store(text_, at + static_cast<std::size_t>(format_.time), time);
    }
    if (format_.color >= 0) {
      for (std::size_t c = 0; c < 3; ++c) {
        store(text_, at + static_cast<std::size_t>(format_.color) + 2 * c,
              color_value(batch, c, i));
      }
    }
    if (format_.infrared >= 0) {
      store(text_, at + static_cast<std::size_t>(format_.infrared),
            static_cast<std::uint16_t>(clamped(batch, infrared_, i, 65535.0)));
    }
    std::size_t extra_at = at + format_.size;
    for (const int field : extras_) {
      const std::size_t size = size_of(type(field));
      const FieldView view = batch.fields[static_cast<std::size_t>(field)];
      store(text_, extra_at, view.data + i * view.stride, size);
      extra_at += size;
    }
  }

  /// 16 bits a channel, which all values fill alike.
  std::uint16_t color_value(const PointBatch& batch, std::size_t channel, std::size_t i) const {
    if (packed_ >= 0) {
      const std::uint32_t rgb =
          batch.fields[static_cast<std::size_t>(packed_)].get<std::uint32_t>(i);
      return static_cast<std::uint16_t>((rgb >> (16 - 8 * channel) & 255u) * 257u);
    }
    const int field = color_[channel];
    const double v = size_of(type(field)) == 1
                         ? batch.fields[static_cast<std::size_t>(field)].get<std::uint8_t>(i)
                         : value(batch, field, i);
    const double scaled = v * (65535.0 / *full_color_);
    return static_cast<std::uint16_t>(scaled > 0.0 ? std::min(scaled + 0.5, 65535.0) : 0.0);
  }

  std::string describe_extras() const {
    std::string out;
    for (const int field : extras_) {
      const PointField& f = header_.fields[static_cast<std::size_t>(field)];
      out += detail::describe_extra_bytes(f.name, f.type);
    }
    return out;
  }

  /// Those of the LAS file that the points come from, else from what is known of the system.
  void append_crs(std::string* records, std::uint32_t* count) const {
    if (!header_.crs) return;
    const std::uint32_t before = *count;
    if (header_.las && !header_.crs->given) {
      for (const LasRecord& r : header_.las->records) {
        if (r.extended || !detail::is_projection_record(r.user_id, r.record_id)) continue;
        *records += header_.las->bytes->read(r.start, kLasRecordHeader + r.length);
        ++*count;
      }
    }
    if (*count == before) {
      *records += detail::projection_records(*header_.crs, format_id_, count);
    }
  }

  void write_head() {
    std::string projection;
    std::uint32_t projection_count = 0;
    append_crs(&projection, &projection_count);
    std::string records;
    std::uint32_t record_count = 0;
    std::string comments;
    PointStreamHeader frame = header_;
    // A system that is a unit alone has no records of its own.
    if (projection_count > 0) frame.crs.reset();
    for (const std::string& comment : camber_comments(frame)) comments += comment + "\n";
    if (!comments.empty()) {
      records += las_record("Camber", 1, "frame of the coordinates", comments);
      ++record_count;
    }
    if (!extras_.empty()) {
      records += las_record("LASF_Spec", 4, "extra bytes", describe_extras());
      ++record_count;
    }
    records += projection;
    record_count += projection_count;
    if (compress_) {
      records += laz::writer_record(format_id_, record_size_);
      ++record_count;
    }
    const std::size_t header_size = minor_ == 4 ? 375 : 227;
    std::string h(header_size, '\0');
    store(h, 0, "LASF", 4);
    h[24] = 1;
    h[25] = static_cast<char>(minor_);
    store(h, 26, "Camber", 6);
    store(h, 58, "Camber", 6);
    // Formats 6 and later ask for the coordinate system in well-known text, if there is one.
    const bool wkt = header_.crs && detail::takes_wkt(*header_.crs, format_id_);
    // Bit 0: seconds since 1980, less a milliard; clear: seconds of the week.
    const unsigned time_kind = header_.las    ? header_.las->global_encoding & 1u
                               : beyond_week_ ? 1u
                                              : 0u;
    store(h, 6, static_cast<std::uint16_t>((format_.extended || wkt ? 16u : 0u) | time_kind));
    store(h, 94, static_cast<std::uint16_t>(header_size));
    store(h, 96, static_cast<std::uint32_t>(header_size + records.size()));
    store(h, 100, record_count);
    h[104] = static_cast<char>(format_id_ | (compress_ ? 0x80 : 0));
    store(h, 105, static_cast<std::uint16_t>(record_size_));
    const bool old_counts = !format_.extended && count_ <= UINT32_MAX;
    if (minor_ < 4 && count_ > UINT32_MAX) {
      throw std::invalid_argument("the cloud has more points than LAS 1.2 can hold");
    }
    if (old_counts) {
      store(h, 107, static_cast<std::uint32_t>(count_));
      for (std::size_t r = 0; r < 5; ++r) {
        store(h, 111 + 4 * r, static_cast<std::uint32_t>(by_return_[r]));
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Eigen::Index a = static_cast<Eigen::Index>(axis);
      store(h, 131 + 8 * axis, scale_[a]);
      store(h, 155 + 8 * axis, offset_[a]);
      store(h, 179 + 16 * axis, high_[a]);
      store(h, 187 + 16 * axis, low_[a]);
    }
    if (minor_ == 4) {
      store(h, 247, count_);
      for (std::size_t r = 0; r < 15; ++r) store(h, 255 + 8 * r, by_return_[r]);
    }
    out_.write(h.data(), static_cast<std::streamsize>(h.size()));
    out_.write(records.data(), static_cast<std::streamsize>(records.size()));
  }

  std::ostream& out_;
  PointStreamHeader header_;
  bool compress_;
  std::unique_ptr<laz::LazWriter> laz_;
  std::array<int, 3> position_, color_;
  std::optional<double> full_color_;  // of red, green and blue; decided once for all points
  int packed_ = -1, intensity_ = -1, return_number_ = -1, number_of_returns_ = -1,
      class_flags_ = -1, channel_ = -1, direction_ = -1, edge_ = -1, classification_ = -1,
      user_data_ = -1, angle_ = -1, angle_rank_ = -1, source_id_ = -1, time_ = -1, infrared_ = -1;
  std::vector<int> extras_;
  int format_id_ = 0, minor_ = 2;
  LasPointFormat format_;
  std::size_t record_size_ = 0;
  Eigen::Vector3d scale_{1e-4, 1e-4, 1e-4}, offset_{0, 0, 0};
  std::array<std::optional<double>, 3> offset_steps_;  // where the offset is a number of steps
  Eigen::Vector3d low_{0, 0, 0}, high_{0, 0, 0};
  bool grid_set_ = false;
  bool angles_ = false;                       // x and y
  bool beyond_week_ = false;                  // some GPS time is
  std::array<int, 4> flags_{-1, -1, -1, -1};  // of the class, in the order of their bits
  std::string other_intensity_;               // one that LAS's own field does not hold
  std::map<std::string, std::uint64_t> cut_;  // attribute: values that changed
  std::array<std::uint64_t, 15> by_return_{};
  std::uint64_t count_ = 0;
  std::ostream::pos_type start_ = 0;
  std::string text_;
};
}  // namespace

std::unique_ptr<PointSink> make_las_sink(std::ostream& out, const PointStreamHeader& header,
                                         LasPoints points) {
  return std::make_unique<LasSink>(out, header, points);
}

}  // namespace camber
