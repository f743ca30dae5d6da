// Points of E57 files (ASTM E2807): scans of records whose values lie in streams of their own, bit
// by bit, in packets of at most 64 KiB; docs/notes/e57.md.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>

#include "camber/cloud/detail/e57_pages.h"
#include "camber/cloud/e57_file.h"
#include "camber/cloud/formats.h"

namespace camber {
namespace {

using Kind = E57Field::Kind;

constexpr std::size_t kNone = static_cast<std::size_t>(-1);
constexpr std::size_t kPadding = 16;           // bytes behind a stream, so that 9 can be loaded
constexpr std::uint64_t kMostConstant = 4096;  // points of records that take no bits
constexpr std::size_t kMostNotes = 8;          // scans that have sentences of their own

/// The bits of one value of the records, in the order of the records.
class BitStream {
 public:
  void clear() {
    bytes_.assign(kPadding, 0);
    end_ = 0;
    bit_ = 0;
  }
  unsigned char* append(std::size_t size) {
    const auto done = static_cast<std::size_t>(bit_ / 8);
    // Not each time: a stream may be far ahead of the others.
    if (done > end_ / 2) {
      std::memmove(bytes_.data(), bytes_.data() + done, end_ - done);
      end_ -= done;
      bit_ -= 8 * done;
    }
    bytes_.resize(end_ + size + kPadding);
    std::memset(bytes_.data() + end_ + size, 0, kPadding);
    end_ += size;
    return bytes_.data() + end_ - size;
  }
  std::uint64_t bits_left() const { return 8 * static_cast<std::uint64_t>(end_) - bit_; }
  void skip(std::uint64_t bits) { bit_ += bits; }
  /// The `bits` (1 to 64) from the i-th value on.
  std::uint64_t at(std::size_t i, unsigned bits) const {
    const std::uint64_t place = bit_ + static_cast<std::uint64_t>(i) * bits;
    const unsigned char* const first = bytes_.data() + place / 8;
    const unsigned shift = place % 8;
    std::uint64_t word = 0;
    std::memcpy(&word, first, 8);
    word >>= shift;
    if (shift + bits > 64) word |= static_cast<std::uint64_t>(first[8]) << (64 - shift);
    return bits == 64 ? word : word & ((std::uint64_t{1} << bits) - 1);
  }

 private:
  std::vector<unsigned char> bytes_ = std::vector<unsigned char>(kPadding);
  std::size_t end_ = 0;    // of what is in bytes_, without the padding
  std::uint64_t bit_ = 0;  // the next one
};

/// How the values of one channel of a scan become colours of 8 or 16 bits.
struct ColorRange {
  double low = 0.0, full = 255.0;  ///< in the file
  bool wide = false;               ///< 16 bits
};

ColorRange color_range(const E57Scan& scan, const E57Field& field, const std::string& channel) {
  const bool integer = field.kind == Kind::kInteger;
  double low = 0.0, high = 0.0;
  const std::optional<double> minimum = scan.limit(channel + "Minimum"),
                              maximum = scan.limit(channel + "Maximum");
  if (minimum && maximum && std::isfinite(*minimum) && std::isfinite(*maximum)) {
    low = *minimum;
    high = *maximum;
  }
  if (integer && (!(high > low) || high > static_cast<double>(field.maximum))) {
    low = static_cast<double>(field.minimum);
    high = static_cast<double>(field.maximum);
  }
  ColorRange out;
  if (!(high > low)) {
    out.wide = true;
    out.full = integer ? 65535.0 : 1.0;
    return out;
  }
  if (!integer && (low != 0.0 || (high != 255.0 && high != 65535.0))) {
    out = {low, high, true};
    return out;
  }
  // Limits of whole numbers are often those of the points; what counts as full is a power of two.
  out.full = 255.0;
  while (out.full < high && out.full < 0x1p32) out.full = 2.0 * out.full + 1.0;
  out.wide = out.full > 255.0;
  return out;
}

/// A name without letters' case and other signs: "pointSourceId" and "Point_source_id" are one.
std::string plain_name(std::string_view name) {
  std::string out;
  for (const char c : name) {
    if (c >= 'A' && c <= 'Z') out += static_cast<char>(c - 'A' + 'a');
    if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9')) out += c;
  }
  return out;
}

/// The name of an attribute: as in the file, but for intensity's, the colours' and the normals'
/// own, and those that LAS has, which las2e57 writes with the prefix "las:".
std::string attribute_name(const std::string& name) {
  static const std::pair<const char*, const char*> kKnown[] = {
      {"colorRed", "red"},   {"colorGreen", "green"}, {"colorBlue", "blue"},
      {"nor:normalX", "nx"}, {"nor:normalY", "ny"},   {"nor:normalZ", "nz"}};
  for (const auto& [file, ours] : kKnown) {
    if (name == file) return ours;
  }
  if (name.compare(0, 4, "las:") == 0) {
    for (const char* const las :
         {"classification", "user_data", "point_source_id", "scan_direction_flag",
          "edge_of_flight_line", "scan_angle_rank", "gps_time"}) {
      if (plain_name(name.substr(4)) == plain_name(las)) return las;
    }
  }
  return name;
}

/// The smallest type that holds an integer field's values.
ScalarType integer_type(std::int64_t low, std::int64_t high) {
  const auto fits = [&](auto tag) {
    using T = decltype(tag);
    return low >= static_cast<std::int64_t>(std::numeric_limits<T>::min()) &&
           high <= static_cast<std::int64_t>(std::numeric_limits<T>::max());
  };
  if (fits(std::uint8_t{})) return ScalarType::kUint8;
  if (fits(std::int8_t{})) return ScalarType::kInt8;
  if (fits(std::uint16_t{})) return ScalarType::kUint16;
  if (fits(std::int16_t{})) return ScalarType::kInt16;
  if (fits(std::uint32_t{})) return ScalarType::kUint32;
  if (fits(std::int32_t{})) return ScalarType::kInt32;
  return ScalarType::kInt64;
}

/// Where the values of a cloud's attribute are in each scan.
struct Attribute {
  enum class Role { kPosition, kColor, kNormal, kPlain, kScan } role = Role::kPlain;
  std::string name;
  ScalarType type = ScalarType::kFloat64;
  std::size_t axis = 0;             // of a position, colour or normal
  std::vector<std::size_t> fields;  // by chosen scan; kNone: it has none
  /// Of a field that states which values are invalid; kNone: all are valid.
  std::vector<std::size_t> flags;
  std::vector<ColorRange> colors;
  std::vector<unsigned char> values;  // of a batch
};

struct Rotation {
  std::array<double, 9> m{1, 0, 0, 0, 1, 0, 0, 0, 1};
  void apply(double& x, double& y, double& z) const {
    const double a = m[0] * x + m[1] * y + m[2] * z, b = m[3] * x + m[4] * y + m[5] * z,
                 c = m[6] * x + m[7] * y + m[8] * z;
    x = a;
    y = b;
    z = c;
  }
};

/// A scan that is read.
struct Chosen {
  std::size_t number = 0;  // in the file
  const E57Scan* scan = nullptr;
  std::array<std::size_t, 3> position{kNone, kNone, kNone};
  bool spherical = false;
  std::size_t invalid_field = kNone;
  bool posed = false;
  Rotation rotation;
  std::array<double, 3> translation{};
};

class E57Source : public FormatSource {
 public:
  E57Source(std::unique_ptr<FileReader> file, const ReadOptions& options);

  bool next(PointBatch& batch) override;

 private:
  [[noreturn]] void fail_scan(const E57Scan& scan, const std::string& reason) const;
  void choose_scans();
  Chosen prepare(std::size_t number);
  void add_attributes();
  void add_attribute(const std::string& name, const std::vector<std::size_t>& fields);
  ScalarType common_type(const Attribute& attribute) const;
  void open_scan();
  void read_packet();
  std::uint64_t records_ready() const;
  void decode(std::size_t count);
  void decode_positions(std::size_t count);
  void decode_normals(std::size_t count);
  void decode_attribute(Attribute& attribute, std::size_t count);
  template <typename Store>
  void decode_field(std::size_t field, std::size_t count, Store&& store);
  std::vector<double> numbers(std::size_t field, std::size_t count);
  std::size_t keep_valid(std::size_t count);
  void finish();

  std::shared_ptr<E57File> e57_;
  std::unique_ptr<detail::E57Pages> pages_;
  std::vector<Chosen> chosen_;
  std::vector<Attribute> attributes_;
  std::vector<unsigned char> packet_, keep_;

  std::size_t now_ = kNone;            // index of the scan being read
  std::uint64_t left_ = 0;             // its records
  std::uint64_t place_ = 0, end_ = 0;  // of its next packet and of its section, logical
  std::uint64_t packet_place_ = 0;     // of the last packet, physical
  std::vector<BitStream> streams_;
  std::uint64_t invalid_ = 0;  // of the scan being read
  std::uint64_t out_of_range_ = 0;
  bool range_left_ = false;  // within a batch
  bool finished_ = false;
};

E57Source::E57Source(std::unique_ptr<FileReader> file, const ReadOptions& options)
    : FormatSource(std::move(file), options), e57_(std::make_shared<E57File>()) {
  report_.format = CloudFormat::kE57;
  *e57_ = read_e57_file(file_->bytes(), options_.lenient, &pages_, &report_.notes);
  header_.e57 = e57_;
  report_.encoding =
      "version " + std::to_string(e57_->version_major) + "." + std::to_string(e57_->version_minor) +
      ", " + std::to_string(e57_->scans.size()) + (e57_->scans.size() == 1 ? " scan" : " scans");
  CoordinateSystem crs;
  if (!options_.own_frame) {
    crs = coordinate_system_from_wkt(e57_->coordinate_metadata);
    if (crs.kind == CoordinateSystem::Kind::kUnknown && !e57_->coordinate_metadata.empty()) {
      report_.notes.push_back("the coordinate metadata (" +
                              shown(e57_->coordinate_metadata.substr(0, 60)) +
                              ") are no well-known text and are not interpreted");
      crs = {};
    }
  }
  take_crs(crs);
  choose_scans();
  add_attributes();
  for (const Attribute& attribute : attributes_) {
    PointField field;
    field.name = attribute.name;
    field.type = attribute.type;
    header_.fields.push_back(std::move(field));
  }
  bool all_valid = !options_.lenient;
  std::uint64_t count = 0;
  for (const Chosen& chosen : chosen_) {
    all_valid = all_valid && chosen.invalid_field == kNone;
    count += chosen.scan->points;
  }
  report_.declared = count;
  if (all_valid) header_.count = count;
}

void E57Source::fail_scan(const E57Scan& scan, const std::string& reason) const {
  const auto number = static_cast<std::size_t>(&scan - e57_->scans.data());
  throw InputError(file_->name(), "/data3D/" + std::to_string(number), reason);
}

void E57Source::choose_scans() {
  const std::size_t count = e57_->scans.size();
  if (options_.scan && *options_.scan >= count) {
    throw InputError(file_->name(),
                     "found " + std::to_string(count) + (count == 1 ? " scan" : " scans") +
                         ", expected one of the number " + std::to_string(*options_.scan) +
                         " (scans are counted from 0)");
  }
  if (options_.own_frame && !options_.scan && count > 1) {
    throw InputError(file_->name(), "found " + std::to_string(count) +
                                        " scans, each with a frame of its own; expected one, or "
                                        "the number of one");
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (!options_.scan || *options_.scan == i) chosen_.push_back(prepare(i));
  }
}

Chosen E57Source::prepare(std::size_t number) {
  E57Scan& scan = e57_->scans[number];
  Chosen out;
  out.number = number;
  out.scan = &scan;
  const auto find = [&](const char* name) {
    for (std::size_t f = 0; f < scan.fields.size(); ++f) {
      if (scan.fields[f].name == name && scan.fields[f].kind != Kind::kString) return f;
    }
    return kNone;
  };
  out.position = {find("cartesianX"), find("cartesianY"), find("cartesianZ")};
  if (out.position[0] == kNone || out.position[1] == kNone) {
    out.position = {find("sphericalRange"), find("sphericalAzimuth"), find("sphericalElevation")};
    out.spherical = true;
    if (out.position[0] == kNone && scan.points > 0) {
      fail_scan(scan,
                "found no coordinates, expected cartesianX, Y, Z or sphericalRange, Azimuth, "
                "Elevation");
    }
  }
  if (out.position[2] == kNone && scan.points > 0) {
    report_.notes.push_back("scan " + std::to_string(number) + " has no " +
                            (out.spherical ? "sphericalElevation" : "cartesianZ") +
                            "; it is read as 0");
  }
  out.invalid_field = find(out.spherical ? "sphericalInvalidState" : "cartesianInvalidState");
  if (scan.pose && !options_.own_frame) {
    std::array<double, 4> q = scan.pose->rotation;
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(norm > 1e-6 && norm < 1e6)) {
      fail_scan(scan, "found a rotation that is none (w x y z of length " + std::to_string(norm) +
                          "), expected a quaternion of length 1");
    }
    constexpr double kRounding = 1e-6;
    if (std::abs(norm - 1.0) > kRounding) {
      report_.notes.push_back("the rotation of scan " + std::to_string(number) +
                              " has the length " + std::to_string(norm) +
                              " and is taken as one of length 1");
    }
    // Scaling one that is 1 up to rounding would only add to it.
    if (std::abs(norm - 1.0) > 1e-12) {
      for (double& component : q) component /= norm;
    }
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    out.posed = true;
    out.rotation.m = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                      2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                      2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    out.translation = scan.pose->translation;
  }
  // A record count that the section has no room for must cost no memory.
  std::uint64_t bits = 0;
  for (const E57Field& field : scan.fields) bits += field.kind == Kind::kString ? 8 : field.bits();
  if (bits == 0 && scan.points > kMostConstant) {
    fail_scan(scan, "found " + std::to_string(scan.points) + " records that take no bits");
  }
  if (bits > 0) {
    const std::uint64_t room = pages_->logical_size() * 8 / bits;
    if (scan.points > room) {
      if (!options_.lenient) {
        fail_scan(scan, "found " + std::to_string(scan.points) + " records of " +
                            std::to_string(bits) + " bits, expected at most " +
                            std::to_string(room) + ", which the file has room for");
      }
      report_.drop("truncated", scan.points - room);
      scan.points = room;
    }
  }
  return out;
}

/// Of the fields that an attribute has in the scans.
ScalarType E57Source::common_type(const Attribute& attribute) const {
  std::int64_t low = INT64_MAX, high = INT64_MIN;
  bool floats = false, doubles = false, missing = false;
  for (std::size_t s = 0; s < chosen_.size(); ++s) {
    if (attribute.fields[s] == kNone) {
      missing = missing || chosen_[s].scan->points > 0;
      continue;
    }
    const E57Field& field = chosen_[s].scan->fields[attribute.fields[s]];
    missing = missing || attribute.flags[s] != kNone;
    switch (field.kind) {
      case Kind::kInteger:
        low = std::min(low, field.minimum);
        high = std::max(high, field.maximum);
        break;
      case Kind::kFloat32:
        floats = true;
        break;
      default:
        doubles = true;
    }
  }
  const bool integers = low <= high;
  constexpr std::int64_t kExact = std::int64_t{1} << 24;  // whole numbers that a float holds
  if (doubles || ((floats || missing) && integers && (low < -kExact || high > kExact))) {
    return ScalarType::kFloat64;
  }
  if (floats || missing) return ScalarType::kFloat32;
  return integer_type(low, high);
}

void E57Source::add_attribute(const std::string& name, const std::vector<std::size_t>& fields) {
  static const std::pair<const char*, const char*> kFlags[] = {{"red", "isColorInvalid"},
                                                               {"green", "isColorInvalid"},
                                                               {"blue", "isColorInvalid"},
                                                               {"intensity", "isIntensityInvalid"},
                                                               {"timeStamp", "isTimeStampInvalid"}};
  Attribute out;
  out.name = name;
  out.fields = fields;
  out.flags.assign(chosen_.size(), kNone);
  for (std::size_t s = 0; s < chosen_.size(); ++s) {
    if (fields[s] == kNone) continue;
    for (const auto& [attribute, flag] : kFlags) {
      if (name != attribute) continue;
      const std::vector<E57Field>& all = chosen_[s].scan->fields;
      for (std::size_t f = 0; f < all.size(); ++f) {
        if (all[f].name == flag && all[f].kind != Kind::kString) out.flags[s] = f;
      }
    }
  }
  out.type = common_type(out);
  const char* const colors[] = {"red", "green", "blue"};
  const char* const channels[] = {"colorRed", "colorGreen", "colorBlue"};
  const char* const normals[] = {"nx", "ny", "nz"};
  for (std::size_t k = 0; k < 3; ++k) {
    if (name == normals[k]) {
      out.role = Attribute::Role::kNormal;
      out.axis = k;
      out.type = ScalarType::kFloat32;
    }
    if (name != colors[k]) continue;
    out.role = Attribute::Role::kColor;
    out.axis = k;
    for (std::size_t s = 0; s < chosen_.size(); ++s) {
      out.colors.emplace_back();
      if (fields[s] == kNone) continue;
      const E57Scan& scan = *chosen_[s].scan;
      out.colors.back() = color_range(scan, scan.fields[fields[s]], channels[k]);
    }
  }
  attributes_.push_back(std::move(out));
}

void E57Source::add_attributes() {
  bool single = !chosen_.empty(), one_posed = false;
  for (const Chosen& chosen : chosen_) {
    one_posed = one_posed || chosen.posed;
    for (const std::size_t field : chosen.position) {
      single = single && !chosen.spherical &&
               (field == kNone || chosen.scan->fields[field].kind == Kind::kFloat32);
    }
  }
  const char* const axes[] = {"x", "y", "z"};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Attribute out;
    out.role = Attribute::Role::kPosition;
    out.name = axes[axis];
    out.axis = axis;
    out.type = single && !one_posed ? ScalarType::kFloat32 : ScalarType::kFloat64;
    attributes_.push_back(std::move(out));
  }
  // Attributes in the order in which the scans have them first.
  static const std::set<std::string> kOwn = {"cartesianX",
                                             "cartesianY",
                                             "cartesianZ",
                                             "sphericalRange",
                                             "sphericalAzimuth",
                                             "sphericalElevation",
                                             "cartesianInvalidState",
                                             "sphericalInvalidState",
                                             "isColorInvalid",
                                             "isIntensityInvalid",
                                             "isTimeStampInvalid"};
  std::vector<std::pair<std::string, std::vector<std::size_t>>> found;
  std::set<std::string> texts;
  for (std::size_t s = 0; s < chosen_.size(); ++s) {
    const std::vector<E57Field>& fields = chosen_[s].scan->fields;
    for (std::size_t f = 0; f < fields.size(); ++f) {
      if (kOwn.count(fields[f].name) > 0) continue;
      if (fields[f].kind == Kind::kString) {
        if (texts.insert(fields[f].name).second) {
          report_.notes.push_back("'" + fields[f].name + "' holds text and is not read");
        }
        continue;
      }
      const std::string name = attribute_name(fields[f].name);
      auto at = std::find_if(found.begin(), found.end(),
                             [&](const auto& entry) { return entry.first == name; });
      if (at == found.end()) {
        found.emplace_back(name, std::vector<std::size_t>(chosen_.size(), kNone));
        at = found.end() - 1;
      }
      if (at->second[s] == kNone) at->second[s] = f;
    }
  }
  for (const auto& [name, fields] : found) add_attribute(name, fields);
  // Colours of all scans and channels have one width.
  bool wide = false;
  for (const Attribute& attribute : attributes_) {
    for (std::size_t s = 0; s < attribute.colors.size(); ++s) {
      wide = wide || (attribute.fields[s] != kNone && attribute.colors[s].wide);
    }
  }
  for (Attribute& attribute : attributes_) {
    if (attribute.role != Attribute::Role::kColor) continue;
    attribute.type = wide ? ScalarType::kUint16 : ScalarType::kUint8;
  }
  if (chosen_.size() > 1) {
    Attribute scan;
    scan.role = Attribute::Role::kScan;
    scan.name = "scan";
    scan.type = ScalarType::kInt32;
    attributes_.push_back(std::move(scan));
  }
  std::set<std::string> names;
  for (Attribute& attribute : attributes_) {
    while (!names.insert(attribute.name).second) attribute.name += "_";
  }
  std::set<std::pair<double, double>> limits;
  for (const Chosen& chosen : chosen_) {
    const std::optional<double> low = chosen.scan->limit("intensityMinimum"),
                                high = chosen.scan->limit("intensityMaximum");
    if (low && high) limits.emplace(*low, *high);
  }
  if (limits.size() > 1) {
    report_.notes.emplace_back(
        "the scans' intensities have different limits and are kept as they are");
  }
}

void E57Source::open_scan() {
  const E57Scan& scan = *chosen_[now_].scan;
  left_ = scan.points;
  invalid_ = 0;
  streams_.assign(scan.fields.size(), {});
  place_ = end_ = 0;
  if (left_ == 0) return;
  // Section header of a compressed vector: kind, length, places of its data and of its index.
  constexpr std::size_t kHeader = 32;
  std::uint64_t start = 0;
  if (!pages_->to_logical(scan.section, &start) || pages_->logical_size() - start < kHeader) {
    fail_scan(scan, "found points from byte " + std::to_string(scan.section) +
                        ", expected a place within the file");
  }
  unsigned char header[kHeader];
  pages_->read(start, kHeader, header);
  std::uint64_t length = 0, data = 0;
  std::memcpy(&length, header + 8, 8);
  std::memcpy(&data, header + 16, 8);
  if (header[0] != 1) {
    file_->fail_at(scan.section,
                   "found a section of kind " + std::to_string(header[0]) + ", expected 1, points");
  }
  if (length < kHeader || length > pages_->logical_size() - start) {
    if (!options_.lenient) {
      file_->fail_at(scan.section + 8, "found a section of " + std::to_string(length) +
                                           " bytes, expected it to end within the file");
    }
    length = pages_->logical_size() - start;
  }
  end_ = start + length;
  if (!pages_->to_logical(data, &place_) || place_ < start + kHeader || place_ > end_) {
    file_->fail_at(scan.section + 16, "found data from byte " + std::to_string(data) +
                                          ", expected a place within the section");
  }
}

std::uint64_t E57Source::records_ready() const {
  const std::vector<E57Field>& fields = chosen_[now_].scan->fields;
  std::uint64_t ready = left_;
  for (std::size_t f = 0; f < fields.size(); ++f) {
    const unsigned bits = fields[f].bits();
    if (bits > 0) ready = std::min(ready, streams_[f].bits_left() / bits);
  }
  return ready;
}

/// The next packet with values goes to the streams; none is left where place_ reaches end_.
void E57Source::read_packet() {
  constexpr std::size_t kStart = 4, kDataHeader = 6;
  enum Type : unsigned char { kIndex = 0, kData = 1, kEmpty = 2 };
  while (place_ < end_) {
    packet_place_ = pages_->physical(place_);
    if (end_ - place_ < kStart) {
      place_ = end_;
      return;
    }
    unsigned char start[kStart];
    pages_->read(place_, kStart, start);
    const std::size_t length = std::size_t{1} + start[2] + 256u * start[3];
    if (length > end_ - place_ || length < kStart) {
      if (options_.lenient) {
        place_ = end_;
        return;
      }
      file_->fail_at(packet_place_, "found a packet of " + std::to_string(length) +
                                        " bytes, expected it to end within its section, which "
                                        "has " +
                                        std::to_string(end_ - place_) + " more");
    }
    if (start[0] == kIndex || start[0] == kEmpty) {
      place_ += length;
      continue;
    }
    if (start[0] != kData) {
      if (options_.lenient) {
        place_ = end_;
        return;
      }
      file_->fail_at(packet_place_, "found a packet of kind " + std::to_string(start[0]) +
                                        ", expected 0 (index), 1 (data) or 2 (empty)");
    }
    packet_.resize(length);
    pages_->read(place_, length, packet_.data());
    const std::size_t count = streams_.size();
    const std::size_t found = length < kDataHeader ? 0 : packet_[4] + 256u * packet_[5];
    std::size_t total = kDataHeader + 2 * count;
    if (found == count && total <= length) {
      for (std::size_t f = 0; f < count; ++f) {
        total += packet_[kDataHeader + 2 * f] + 256u * packet_[kDataHeader + 2 * f + 1];
      }
    }
    if (found != count || total > length) {
      if (options_.lenient) {
        place_ = end_;
        return;
      }
      file_->fail_at(packet_place_, "found a packet of " + std::to_string(found) + " streams in " +
                                        std::to_string(length) + " bytes, expected " +
                                        std::to_string(count) + " that fit in it");
    }
    std::size_t at = kDataHeader + 2 * count;
    for (std::size_t f = 0; f < count; ++f) {
      const std::size_t size =
          packet_[kDataHeader + 2 * f] + 256u * packet_[kDataHeader + 2 * f + 1];
      if (size > 0 && chosen_[now_].scan->fields[f].kind != Kind::kString) {
        std::memcpy(streams_[f].append(size), packet_.data() + at, size);
      }
      at += size;
    }
    place_ += length;
    return;
  }
}

/// Calls store(i, value) with a std::int64_t, double or float for each of the next records.
template <typename Store>
void E57Source::decode_field(std::size_t index, std::size_t count, Store&& store) {
  const E57Field& field = chosen_[now_].scan->fields[index];
  const BitStream& stream = streams_[index];
  const unsigned bits = field.bits();
  if (field.kind == Kind::kFloat32) {
    for (std::size_t i = 0; i < count; ++i) {
      const auto word = static_cast<std::uint32_t>(stream.at(i, 32));
      float value = 0.0f;
      std::memcpy(&value, &word, sizeof value);
      store(i, value);
    }
    return;
  }
  if (field.kind == Kind::kFloat64) {
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint64_t word = stream.at(i, 64);
      double value = 0.0;
      std::memcpy(&value, &word, sizeof value);
      store(i, value);
    }
    return;
  }
  const auto low = static_cast<std::uint64_t>(field.minimum);
  const std::uint64_t range = static_cast<std::uint64_t>(field.maximum) - low;
  const bool scaled = field.kind == Kind::kScaledInteger;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t raw = bits == 0 ? 0 : stream.at(i, bits);
    if (raw > range) {
      if (!options_.lenient) {
        file_->fail_at(packet_place_, "found a value of '" + field.name +
                                          "' in this packet or before it above its maximum, " +
                                          std::to_string(field.maximum));
      }
      keep_[i] = 0;
      range_left_ = true;
    }
    const auto value = static_cast<std::int64_t>(low + std::min(raw, range));
    if (scaled) {
      store(i, static_cast<double>(value) * field.scale + field.offset);
    } else {
      store(i, value);
    }
  }
}

std::vector<double> E57Source::numbers(std::size_t field, std::size_t count) {
  std::vector<double> out(count, 0.0);
  if (field == kNone) return out;
  decode_field(field, count,
               [&](std::size_t i, auto value) { out[i] = static_cast<double>(value); });
  return out;
}

void E57Source::decode_positions(std::size_t count) {
  const Chosen& chosen = chosen_[now_];
  std::array<std::vector<double>, 3> x;
  for (std::size_t axis = 0; axis < 3; ++axis) x[axis] = numbers(chosen.position[axis], count);
  if (chosen.spherical) {
    for (std::size_t i = 0; i < count; ++i) {
      const double range = x[0][i], azimuth = x[1][i], elevation = x[2][i];
      x[0][i] = range * std::cos(elevation) * std::cos(azimuth);
      x[1][i] = range * std::cos(elevation) * std::sin(azimuth);
      x[2][i] = range * std::sin(elevation);
    }
  }
  if (chosen.posed) {
    for (std::size_t i = 0; i < count; ++i) {
      chosen.rotation.apply(x[0][i], x[1][i], x[2][i]);
      for (std::size_t axis = 0; axis < 3; ++axis) x[axis][i] += chosen.translation[axis];
    }
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    with_type(attributes_[axis].type, [&](auto tag) {
      using T = decltype(tag);
      for (std::size_t i = 0; i < count; ++i) {
        const T value = static_cast<T>(x[axis][i]);
        std::memcpy(attributes_[axis].values.data() + i * sizeof(T), &value, sizeof(T));
      }
    });
  }
}

void E57Source::decode_normals(std::size_t count) {
  std::array<Attribute*, 3> found{};
  for (Attribute& attribute : attributes_) {
    if (attribute.role == Attribute::Role::kNormal) found[attribute.axis] = &attribute;
  }
  if (found[0] == nullptr && found[1] == nullptr && found[2] == nullptr) return;
  std::array<std::vector<double>, 3> n;
  bool whole = true;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t field = found[axis] == nullptr ? kNone : found[axis]->fields[now_];
    whole = whole && field != kNone;
    n[axis] = numbers(field, count);
    if (field == kNone) {
      n[axis].assign(count, std::numeric_limits<double>::quiet_NaN());
    }
  }
  for (std::size_t i = 0; whole && chosen_[now_].posed && i < count; ++i) {
    chosen_[now_].rotation.apply(n[0][i], n[1][i], n[2][i]);
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (found[axis] == nullptr) continue;
    for (std::size_t i = 0; i < count; ++i) {
      const auto value = static_cast<float>(n[axis][i]);
      std::memcpy(found[axis]->values.data() + i * sizeof value, &value, sizeof value);
    }
  }
}

void E57Source::decode_attribute(Attribute& attribute, std::size_t count) {
  const bool scan_number = attribute.role == Attribute::Role::kScan;
  const std::size_t field = scan_number ? kNone : attribute.fields[now_];
  std::vector<double> flags;
  if (!scan_number && attribute.flags[now_] != kNone) flags = numbers(attribute.flags[now_], count);
  const auto flagged = [&](std::size_t i) { return !flags.empty() && flags[i] != 0.0; };
  with_type(attribute.type, [&](auto tag) {
    using T = decltype(tag);
    T empty{};
    if constexpr (std::is_floating_point_v<T>) empty = std::numeric_limits<T>::quiet_NaN();
    if (scan_number) empty = static_cast<T>(chosen_[now_].number);
    const auto put = [&](std::size_t i, T value) {
      std::memcpy(attribute.values.data() + i * sizeof(T), &value, sizeof(T));
    };
    if (field == kNone) {
      for (std::size_t i = 0; i < count; ++i) put(i, empty);
      return;
    }
    if (attribute.role == Attribute::Role::kColor) {
      const ColorRange& range = attribute.colors[now_];
      const double full = static_cast<double>(std::numeric_limits<std::uint16_t>::max());
      const double most = attribute.type == ScalarType::kUint8 ? 255.0 : full;
      decode_field(field, count, [&](std::size_t i, auto value) {
        const double share = (static_cast<double>(value) - range.low) / (range.full - range.low);
        const double color = std::isnan(share) ? 0.0 : std::clamp(share, 0.0, 1.0) * most;
        put(i, static_cast<T>(flagged(i) ? 0.0 : std::floor(color + 0.5)));
      });
      return;
    }
    decode_field(field, count, [&](std::size_t i, auto value) {
      put(i, flagged(i) ? empty : static_cast<T>(value));
    });
  });
}

void E57Source::decode(std::size_t count) {
  const Chosen& chosen = chosen_[now_];
  keep_.assign(count, 1);
  range_left_ = false;
  for (Attribute& attribute : attributes_) attribute.values.resize(count * size_of(attribute.type));
  if (chosen.invalid_field != kNone) {
    decode_field(chosen.invalid_field, count, [&](std::size_t i, auto value) {
      if (value != 0) keep_[i] = 0;
    });
    invalid_ += static_cast<std::uint64_t>(std::count(keep_.begin(), keep_.end(), 0));
  }
  const auto valid = static_cast<std::uint64_t>(std::count(keep_.begin(), keep_.end(), 1));
  decode_positions(count);
  decode_normals(count);
  for (Attribute& attribute : attributes_) {
    if (attribute.role == Attribute::Role::kPosition ||
        attribute.role == Attribute::Role::kNormal) {
      continue;
    }
    decode_attribute(attribute, count);
  }
  if (range_left_) {
    out_of_range_ += valid - static_cast<std::uint64_t>(std::count(keep_.begin(), keep_.end(), 1));
  }
  for (std::size_t f = 0; f < streams_.size(); ++f) {
    streams_[f].skip(static_cast<std::uint64_t>(chosen.scan->fields[f].bits()) * count);
  }
}

/// Moves the values of valid points together. @return their number.
std::size_t E57Source::keep_valid(std::size_t count) {
  const auto kept = static_cast<std::size_t>(std::count(keep_.begin(), keep_.end(), 1));
  if (kept == count) return count;
  for (Attribute& attribute : attributes_) {
    const std::size_t size = size_of(attribute.type);
    unsigned char* to = attribute.values.data();
    for (std::size_t i = 0; i < count; ++i) {
      if (keep_[i] == 0) continue;
      std::memmove(to, attribute.values.data() + i * size, size);
      to += size;
    }
  }
  return kept;
}

bool E57Source::next(PointBatch& batch) {
  batch.clear();
  for (;;) {
    if (now_ == kNone || left_ == 0) {
      if (now_ != kNone && now_ < chosen_.size()) {
        report_.invalid_by_scan.emplace_back(chosen_[now_].number, invalid_);
        report_.drop("invalid in the file", invalid_);
      }
      now_ = now_ == kNone ? 0 : std::min(now_ + 1, chosen_.size());
      if (now_ == chosen_.size()) {
        finish();
        return false;
      }
      open_scan();
      continue;
    }
    while (place_ < end_ && records_ready() < std::min<std::uint64_t>(left_, kBatchSize)) {
      read_packet();
    }
    const std::uint64_t ready = std::min<std::uint64_t>(records_ready(), kBatchSize);
    if (ready == 0) {
      const E57Scan& scan = *chosen_[now_].scan;
      if (!options_.lenient) {
        fail_scan(scan, "found the end of the points after " + std::to_string(scan.points - left_) +
                            " records, expected " + std::to_string(scan.points));
      }
      report_.drop("truncated", left_);
      left_ = 0;
      continue;
    }
    const auto count = static_cast<std::size_t>(ready);
    decode(count);
    left_ -= count;
    const std::size_t kept = keep_valid(count);
    if (kept == 0) continue;
    batch.count = kept;
    for (const Attribute& attribute : attributes_) {
      batch.fields.push_back({attribute.values.data(), size_of(attribute.type)});
    }
    report_.points += kept;
    return true;
  }
}

void E57Source::finish() {
  if (finished_) return;
  finished_ = true;
  report_.drop("out of range", out_of_range_);
  // Of the pictures, too, where the whole file is read.
  if (!options_.scan) pages_->check_rest();
  if (pages_->wrong_pages() > 0) {
    report_.notes.push_back(std::to_string(pages_->wrong_pages()) +
                            " of the pages that were read have a wrong checksum");
  }
}

}  // namespace

std::unique_ptr<PointSource> open_e57(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<E57Source>(std::move(file), options);
}

}  // namespace camber
