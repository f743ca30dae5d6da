#include "camber/cloud/detail/las_format.h"

#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace camber::detail {

LasPointFormat las_point_format(int id) {
  // Sizes and offsets from the tables of the specification.
  static const LasPointFormat kFormats[] = {
      {20, false, -1, -1, -1, -1}, {28, false, 20, -1, -1, -1}, {26, false, -1, 20, -1, -1},
      {34, false, 20, 28, -1, -1}, {57, false, 20, -1, -1, 28}, {63, false, 20, 28, -1, 34},
      {30, true, 22, -1, -1, -1},  {36, true, 22, 30, -1, -1},  {38, true, 22, 30, 36, -1},
      {59, true, 22, -1, -1, 30},  {67, true, 22, 30, 36, 38},
  };
  return kFormats[id];
}

int las_extended_format(int id) {
  const LasPointFormat format = las_point_format(id);
  return format.infrared >= 0 ? 8 : format.color >= 0 ? 7 : 6;
}

int las_class_of(const unsigned char* record, const LasPointFormat& format) {
  return format.extended ? record[16] : record[15] & 31;
}

void extend_las_record(const unsigned char* from, const LasPointFormat& from_format,
                       unsigned char* to, const LasPointFormat& to_format) {
  constexpr std::size_t kTimeOfExtended = 22;
  if (from_format.extended) {
    std::memcpy(to, from, kTimeOfExtended + 8);
  } else {
    std::memcpy(to, from, 14);
    const unsigned returns = from[14], flags = from[15] >> 5;
    int point_class = las_class_of(from, from_format);
    unsigned overlap = 0;
    if (point_class == kLasOverlapClass) {
      point_class = 1;
      overlap = 1;
    }
    to[14] = static_cast<unsigned char>((returns & 7u) | (returns >> 3 & 7u) << 4);
    // The direction of the scan and the edge of the flight line keep their bits.
    to[15] = static_cast<unsigned char>(flags | overlap << 3 | (returns & 0xc0u));
    to[16] = static_cast<unsigned char>(point_class);
    to[17] = from[17];
    const auto degrees = static_cast<signed char>(from[16]);
    const auto angle = static_cast<std::int16_t>(std::lround(degrees / kLasAngleUnit));
    std::memcpy(to + 18, &angle, sizeof angle);
    std::memcpy(to + 20, from + 18, 2);
    const double time = from_format.time < 0 ? 0.0 : load<double>(from + from_format.time);
    std::memcpy(to + kTimeOfExtended, &time, sizeof time);
  }
  if (to_format.color >= 0) std::memcpy(to + to_format.color, from + from_format.color, 6);
  if (to_format.infrared >= 0) {
    std::memcpy(to + to_format.infrared, from + from_format.infrared, 2);
  }
}

ScalarType las_extra_type(int id) {
  static const ScalarType kTypes[] = {
      ScalarType::kUint8,   ScalarType::kInt8,   ScalarType::kUint16, ScalarType::kInt16,
      ScalarType::kUint32,  ScalarType::kInt32,  ScalarType::kUint64, ScalarType::kInt64,
      ScalarType::kFloat32, ScalarType::kFloat64};
  return kTypes[(id - 1) % 10];
}

std::string las_record(const char* user, std::uint16_t id, const char* description,
                       const std::string& content) {
  std::string out(kLasRecordHeader, '\0');
  store(out, 2, user, std::strlen(user));
  store(out, 18, id);
  store(out, 20, static_cast<std::uint16_t>(content.size()));
  store(out, 22, description, std::strlen(description));
  return out + content;
}

std::string describe_extra_bytes(const std::string& name, ScalarType type) {
  std::string out(kLasExtraDescription, '\0');
  for (int id = 1; id <= 10; ++id) {
    if (las_extra_type(id) == type) out[2] = static_cast<char>(id);
  }
  const std::string shown_name = name.substr(0, 31);
  store(out, 4, shown_name.data(), shown_name.size());
  return out;
}

bool is_projection_record(const std::string& user_id, int record_id) {
  const bool keys = record_id >= 34735 && record_id <= 34737;
  const bool wkt = record_id == 2111 || record_id == 2112;
  return (user_id == "LASF_Projection" && (keys || wkt)) || (user_id == "liblas" && wkt);
}

bool takes_wkt(const CoordinateSystem& crs, int point_format) {
  return !crs.wkt.empty() && (point_format >= 6 || crs.epsg == 0);
}

std::string projection_records(const CoordinateSystem& crs, int point_format,
                               std::uint32_t* count) {
  const char* const user = "LASF_Projection";
  if (takes_wkt(crs, point_format)) {
    if (crs.wkt.size() + 1 > UINT16_MAX) {
      throw std::invalid_argument("the coordinate system's text has " +
                                  std::to_string(crs.wkt.size()) +
                                  " bytes, expected at most 65534 for LAS");
    }
    ++*count;
    return las_record(user, 2112, "OGC WKT", crs.wkt + '\0');
  }
  if (crs.epsg == 0) return {};
  // Keys in ascending order: model, raster, system, unit, vertical system and unit.
  using Kind = CoordinateSystem::Kind;
  const bool unknown = crs.kind == Kind::kUnknown;
  const CoordinateSystem by_code = coordinate_system_from_epsg(crs.epsg);
  const bool geographic = (unknown ? by_code.kind : crs.kind) == Kind::kGeographic;
  const bool geocentric = crs.kind == Kind::kGeocentric;
  std::vector<std::array<std::uint16_t, 4>> keys = {{1, 1, 0, 0}};
  const auto add = [&](int key, int value) {
    if (value <= 0 || value > UINT16_MAX) return;
    keys.push_back({static_cast<std::uint16_t>(key), 0, 1, static_cast<std::uint16_t>(value)});
  };
  add(1024, geographic ? 2 : geocentric ? 3 : 1);
  add(1025, 1);
  add(geographic || geocentric ? 2048 : 3072, crs.epsg);
  if (geographic && crs.horizontal.angle) add(2054, crs.horizontal.epsg);
  if (!geographic && !geocentric) add(3076, crs.horizontal.epsg);
  add(4096, crs.vertical_epsg);
  if (crs.vertical_stated) add(4099, crs.vertical.epsg);
  keys[0][3] = static_cast<std::uint16_t>(keys.size() - 1);
  ++*count;
  return las_record(user, 34735, "GeoTIFF keys",
                    std::string(reinterpret_cast<const char*>(keys.data()), 8 * keys.size()));
}

}  // namespace camber::detail
