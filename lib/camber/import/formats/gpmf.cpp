#include "camber/import/formats/gpmf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string_view>

#include "camber/core/errors.h"
#include "camber/core/median.h"
#include "camber/core/read_file.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr std::uint64_t kMostPayload = std::uint64_t{1} << 26;  // bytes
constexpr double kRangeSigma = 1.5;     // m, of one range of a civil receiver under open sky
constexpr double kMostDilution = 20.0;  // beyond it a receiver has no position worth the name
constexpr int kMostFields = 64;         // of a sample: it has at most 255 bytes

/// One item: key, length and value.
struct Item {
  std::string key;
  char type = 0;
  std::size_t size = 0, repeat = 0;  // bytes of a sample, samples
  std::string_view data;
  std::size_t at = 0;  // of the data in the payload
};

/// One field of samples by rows.
using Rows = std::vector<std::vector<double>>;

std::uint64_t big_endian(std::string_view bytes) {
  std::uint64_t out = 0;
  for (const char byte : bytes) out = (out << 8) | static_cast<unsigned char>(byte);
  return out;
}

/// Bytes of a value of a type that is a number; 0 for others.
std::size_t size_of(char type) {
  switch (type) {
    case 'b':
    case 'B':
      return 1;
    case 's':
    case 'S':
      return 2;
    case 'l':
    case 'L':
    case 'f':
    case 'q':
      return 4;
    case 'j':
    case 'J':
    case 'd':
    case 'Q':
      return 8;
    default:
      return 0;
  }
}

double number_of(char type, std::string_view bytes) {
  const std::uint64_t raw = big_endian(bytes);
  const auto wide = static_cast<std::int64_t>(raw);
  const auto word = static_cast<std::int32_t>(static_cast<std::uint32_t>(raw));
  switch (type) {
    case 'b':
      return static_cast<std::int8_t>(static_cast<std::uint8_t>(raw));
    case 's':
      return static_cast<std::int16_t>(static_cast<std::uint16_t>(raw));
    case 'l':
      return word;
    case 'j':
      return static_cast<double>(wide);
    case 'q':
      return static_cast<double>(word) / 65536.0;
    case 'Q':
      return static_cast<double>(wide) / 4294967296.0;
    case 'f': {
      const auto bits = static_cast<std::uint32_t>(raw);
      float out = 0.0f;
      std::memcpy(&out, &bits, sizeof out);
      return static_cast<double>(out);
    }
    case 'd': {
      double out = 0.0;
      std::memcpy(&out, &raw, sizeof out);
      return out;
    }
    default:
      return static_cast<double>(raw);
  }
}

/// Positions of one kind of stream.
struct Receiver {
  std::vector<GeoPoint> points;
  std::size_t without_fix = 0;
  int fix = 0;
  std::vector<double> dilutions;

  /// @param fix_of  0: none, 2 or 3; negative: not stated
  void add(GeoPoint point, int fix_of, double dilution) {
    const bool somewhere = std::isfinite(point.latitude) && std::isfinite(point.longitude) &&
                           std::abs(point.latitude) <= 90.0 && std::abs(point.longitude) <= 180.0 &&
                           (point.latitude != 0.0 || point.longitude != 0.0);
    const bool fixed = fix_of < 0 || fix_of >= 2;
    if (!somewhere || !fixed || dilution > kMostDilution) {
      ++without_fix;
      return;
    }
    if (fix_of >= 2) fix = fix == 0 ? fix_of : std::min(fix, fix_of);
    if (dilution > 0.0) {
      dilutions.push_back(dilution);
      point.sigma = kRangeSigma * dilution;
    }
    if (!(point.speed >= 0.0)) point.speed = std::numeric_limits<double>::quiet_NaN();
    points.push_back(std::move(point));
  }
};

class GpmfReader {
 public:
  explicit GpmfReader(const fs::path& film) : film_(film) {}

  void take(std::size_t number, const FilmPayload& payload, std::string_view bytes) {
    number_ = number;
    payload_ = &payload;
    for (const Item& device : items(bytes, 0)) {
      if (device.key != "DEVC" || device.type != 0) continue;
      for (const Item& item : items(device.data, device.at)) {
        if (item.key == "DVNM" && item.type == 'c' && out_.device.empty()) {
          out_.device = std::string(item.data.substr(0, item.data.find('\0')));
        }
        if (item.key == "STRM" && item.type == 0) stream(item);
      }
    }
  }

  CameraTelemetry finish() {
    Receiver& best = newer_.points.empty() ? older_ : newer_;
    out_.log.form = "GoPro";
    out_.without_fix = best.without_fix;
    out_.fix = best.fix;
    if (!best.dilutions.empty()) out_.dilution = upper_median(&best.dilutions);
    out_.log.segments.push_back(std::move(best.points));
    return std::move(out_);
  }

 private:
  /// What the items before the samples say of them.
  struct Properties {
    std::vector<double> scale;
    std::string type;
    int fix = -1;
    double dilution = 0.0;
  };

  [[noreturn]] void fail(std::size_t at, const std::string& reason) const {
    throw InputError(film_.string(), fmt::format("payload {}, byte {}", number_, at), reason);
  }

  std::vector<Item> items(std::string_view bytes, std::size_t start) const {
    std::vector<Item> out;
    std::size_t at = 0;
    while (at + 8 <= bytes.size()) {
      Item item;
      item.key = std::string(bytes.substr(at, 4));
      if (item.key == std::string(4, '\0')) break;  // padding
      item.type = bytes[at + 4];
      item.size = static_cast<unsigned char>(bytes[at + 5]);
      item.repeat = big_endian(bytes.substr(at + 6, 2));
      const std::size_t length = item.size * item.repeat, left = bytes.size() - at - 8;
      if (length > left) {
        fail(start + at, fmt::format("found '{}' of {} bytes in the last {}, expected it within",
                                     printable(item.key), length, left));
      }
      item.at = start + at + 8;
      item.data = bytes.substr(at + 8, length);
      out.push_back(std::move(item));
      at += 8 + std::min(left, (length + 3) / 4 * 4);
    }
    return out;
  }

  void stream(const Item& parent) {
    Properties properties;
    for (const Item& item : items(parent.data, parent.at)) {
      if (item.key == "SCAL") properties.scale = flat(rows(item, {}));
      if (item.key == "TYPE") properties.type = std::string(item.data);
      if (item.key == "GPSF") properties.fix = static_cast<int>(first(item, -1.0));
      if (item.key == "GPSP") properties.dilution = first(item, 0.0) / 100.0;
      if (item.key == "GPS5") positions(item, properties, 5, &older_);
      if (item.key == "GPS9") positions(item, properties, 9, &newer_);
      if (item.key == "GRAV") gravity(item, properties);
    }
  }

  static std::vector<double> flat(const Rows& rows) {
    std::vector<double> out;
    for (const auto& row : rows) out.insert(out.end(), row.begin(), row.end());
    return out;
  }

  double first(const Item& item, double missing) const {
    const std::vector<double> all = flat(rows(item, {}));
    return all.empty() ? missing : std::clamp(all.front(), -1e6, 1e6);
  }

  /// The types of a sample's fields: "lllllllSS", or "f[8]L".
  std::vector<char> fields_of(const Item& item, const std::string& type) const {
    std::vector<char> out;
    if (item.type != '?') {
      const std::size_t one = size_of(item.type);
      if (one == 0 || item.size == 0 || item.size % one != 0) {
        fail(item.at,
             fmt::format("found '{}' of the type '{}' and {} bytes a sample, expected "
                         "numbers",
                         printable(item.key), printable(std::string(1, item.type)), item.size));
      }
      out.assign(item.size / one, item.type);
      return out;
    }
    std::size_t bytes = 0;
    for (std::size_t i = 0; i < type.size() && type[i] != '\0'; ++i) {
      std::size_t repeat = 1;
      const char field = type[i];
      if (i + 1 < type.size() && type[i + 1] == '[') {
        repeat = 0;
        for (i += 2; i < type.size() && type[i] >= '0' && type[i] <= '9' && repeat < 100; ++i) {
          repeat = 10 * repeat + static_cast<std::size_t>(type[i] - '0');
        }
      }
      bytes += repeat * size_of(field);
      if (size_of(field) == 0 || out.size() + repeat > kMostFields) break;
      out.insert(out.end(), repeat, field);
    }
    if (out.empty() || bytes != item.size) {
      fail(item.at, fmt::format("found '{}' of {} bytes a sample by the type '{}', expected that "
                                "many of numbers",
                                printable(item.key), item.size, printable(type)));
    }
    return out;
  }

  Rows rows(const Item& item, const Properties& properties) const {
    if (item.repeat == 0) return {};
    const std::vector<char> fields = fields_of(item, properties.type);
    const std::vector<double>& scale = properties.scale;
    if (scale.size() > 1 && scale.size() < fields.size()) {
      fail(item.at, fmt::format("found {} scales of the {} fields of '{}', expected one each",
                                scale.size(), fields.size(), printable(item.key)));
    }
    Rows out(item.repeat);
    for (std::size_t i = 0; i < item.repeat; ++i) {
      std::size_t at = i * item.size;
      for (std::size_t k = 0; k < fields.size(); ++k) {
        const std::size_t bytes = size_of(fields[k]);
        double value = number_of(fields[k], item.data.substr(at, bytes));
        if (!scale.empty()) {
          const double divisor = scale[scale.size() == 1 ? 0 : k];
          if (!(divisor != 0.0 && std::isfinite(divisor))) {
            fail(item.at, fmt::format("found a scale of {} of '{}', expected a number other than 0",
                                      divisor, printable(item.key)));
          }
          value /= divisor;
        }
        out[i].push_back(value);
        at += bytes;
      }
    }
    return out;
  }

  double time_of(std::size_t i, std::size_t count) const {
    return payload_->time_s +
           payload_->duration_s * static_cast<double>(i) / static_cast<double>(count);
  }

  void require_fields(const Item& item, const Rows& samples, std::size_t count) const {
    if (samples.empty() || samples.front().size() >= count) return;
    fail(item.at, fmt::format("found {} fields of '{}', expected {}", samples.front().size(),
                              printable(item.key), count));
  }

  /// Latitude, longitude (degrees), altitude (m), speed over ground and in space (m/s); of the
  /// newer kind then days, seconds, dilution of precision and fix.
  void positions(const Item& item, const Properties& properties, std::size_t count,
                 Receiver* receiver) {
    const Rows samples = rows(item, properties);
    require_fields(item, samples, count);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const std::vector<double>& s = samples[i];
      GeoPoint point;
      point.latitude = s[0];
      point.longitude = s[1];
      if (std::isfinite(s[2])) point.altitude = s[2];
      point.speed = s[4];
      point.time_s = time_of(i, samples.size());
      const bool newer = count == 9;
      receiver->add(std::move(point),
                    newer ? static_cast<int>(std::clamp(s[8], 0.0, 3.0)) : properties.fix,
                    newer ? s[7] : properties.dilution);
    }
  }

  void gravity(const Item& item, const Properties& properties) {
    constexpr double kLeast = 0.5;  // of the length 1: zeros are no vector
    const Rows samples = rows(item, properties);
    require_fields(item, samples, 3);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const Eigen::Vector3d vector(samples[i][0], samples[i][1], samples[i][2]);
      if (!(vector.norm() > kLeast) || !vector.allFinite()) continue;
      out_.gravity.push_back({time_of(i, samples.size()), vector.normalized()});
    }
  }

  fs::path film_;
  std::size_t number_ = 0;
  const FilmPayload* payload_ = nullptr;
  Receiver older_, newer_;
  CameraTelemetry out_;
};

}  // namespace

CameraTelemetry read_gpmf(const fs::path& film, const std::vector<FilmPayload>& payloads) {
  std::ifstream file = open_file(film);
  GpmfReader reader(film);
  std::string bytes;
  for (std::size_t i = 0; i < payloads.size(); ++i) {
    const FilmPayload& payload = payloads[i];
    if (payload.size > kMostPayload) {
      throw InputError(
          film.string(), fmt::format("payload {}", i),
          fmt::format("found {} bytes, expected at most {}", payload.size, kMostPayload));
    }
    bytes.resize(payload.size);
    file.seekg(static_cast<std::streamoff>(payload.offset));
    file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (!file) throw InputError(film.string(), fmt::format("payload {}", i), "cannot be read");
    reader.take(i, payload, bytes);
  }
  return reader.finish();
}

}  // namespace camber
