#include <fmt/format.h>

#include <boost/predef/other/endian.h>
#include <algorithm>
#include <cstring>
#include <limits>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>

#include "camber/cloud/pcl.h"
#include "camber/cloud/point_stream.h"

namespace camber {
namespace {

using pcl::PCLPointField;

std::optional<ScalarType> scalar_type(const PCLPointField& field) {
  switch (field.datatype) {
    case PCLPointField::INT8:
      return ScalarType::kInt8;
    case PCLPointField::BOOL:
    case PCLPointField::UINT8:
      return ScalarType::kUint8;
    case PCLPointField::INT16:
      return ScalarType::kInt16;
    case PCLPointField::UINT16:
      return ScalarType::kUint16;
    case PCLPointField::INT32:
      return ScalarType::kInt32;
    case PCLPointField::UINT32:
      return ScalarType::kUint32;
    case PCLPointField::INT64:
      return ScalarType::kInt64;
    case PCLPointField::UINT64:
      return ScalarType::kUint64;
    case PCLPointField::FLOAT32:
      return ScalarType::kFloat32;
    case PCLPointField::FLOAT64:
      return ScalarType::kFloat64;
    default:
      return std::nullopt;
  }
}

bool is_packed_color(const PCLPointField& field) {
  return (field.name == "rgb" || field.name == "rgba") &&
         (field.datatype == PCLPointField::FLOAT32 || field.datatype == PCLPointField::UINT32);
}

/// One attribute of a RoadCloud as PCL names it.
struct Attribute {
  std::string name;
  PCLPointField::PointFieldTypes type = PCLPointField::FLOAT32;
  FieldView values;  ///< of that type; packed colours are made on the way
  bool color = false;
};

std::vector<Attribute> attributes_of(const RoadCloud& cloud) {
  cloud.validate();
  std::vector<Attribute> out;
  const auto add = [&](const std::string& name, PCLPointField::PointFieldTypes type,
                       const void* data, std::size_t stride) {
    out.push_back({name, type, {static_cast<const unsigned char*>(data), stride}, false});
  };
  const auto add_floats = [&](std::initializer_list<const char*> names, const float* first) {
    const std::size_t stride = names.size() * sizeof(float);
    for (const char* name : names) {
      add(name, PCLPointField::FLOAT32, first, stride);
      if (first) ++first;
    }
  };
  add_floats({"x", "y", "z"}, cloud.empty() ? nullptr : cloud.points[0].data());
  if (!cloud.colors.empty()) {
    add("rgb", PCLPointField::FLOAT32, cloud.colors[0].data(), 3);
    out.back().color = true;
  }
  if (!cloud.normals.empty()) {
    add_floats({"normal_x", "normal_y", "normal_z"}, cloud.normals[0].data());
  }
  if (!cloud.sigmas.empty()) add_floats({"sigma"}, cloud.sigmas.data());
  if (!cloud.covariances.empty()) {
    add_floats({"cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz"},
               cloud.covariances[0].data());
  }
  for (const auto& [name, values] : cloud.labels) {
    add(name, PCLPointField::INT32, values.data(), 4);
  }
  for (const auto& [name, values] : cloud.scalars) add_floats({name.c_str()}, values.data());
  std::set<std::string> names;
  for (const Attribute& attribute : out) {
    if (!names.insert(attribute.name).second) {
      throw std::invalid_argument("cloud attribute '" + attribute.name +
                                  "' is there twice, expected different names");
    }
  }
  return out;
}

/// 0xAARRGGBB, as PCL packs it, opaque.
std::uint32_t packed_color(const FieldView& colors, std::size_t i) {
  std::array<std::uint8_t, 3> rgb;
  std::memcpy(rgb.data(), colors.data + i * colors.stride, 3);
  return 0xFF000000u | static_cast<std::uint32_t>(rgb[0]) << 16 |
         static_cast<std::uint32_t>(rgb[1]) << 8 | rgb[2];
}

/// A value in another type: the nearest that it has; 0 for NaN in a whole number.
template <typename To>
To converted(double value) {
  if constexpr (std::is_floating_point_v<To>) {
    return static_cast<To>(value);
  } else {
    if (!(value > static_cast<double>(std::numeric_limits<To>::min()))) {
      return value != value ? To{0} : std::numeric_limits<To>::min();
    }
    if (value >= static_cast<double>(std::numeric_limits<To>::max())) {
      return std::numeric_limits<To>::max();
    }
    return static_cast<To>(value);
  }
}

}  // namespace

namespace detail {

RoadCloud read_pcl_points(const PclPoints& layout, const void* data) {
  if (layout.count == 0) return {};
  PointStreamHeader header;
  header.count = layout.count;
  std::vector<FieldView> views;
  std::set<std::string> names;
  const auto* const first = static_cast<const unsigned char*>(data);
  for (const PCLPointField& field : layout.fields) {
    const std::optional<ScalarType> type = scalar_type(field);
    const std::size_t values = std::max<std::size_t>(field.count, 1);
    if (!type || field.name == "_") continue;
    if (field.offset + values * size_of(*type) > layout.stride) {
      throw std::invalid_argument(fmt::format("PCL field '{}': found it at byte {} of points of {}",
                                              field.name, field.offset, layout.stride));
    }
    for (std::size_t k = 0; k < values; ++k) {
      PointField column;
      column.name = values == 1 ? field.name : field.name + "_" + std::to_string(k);
      column.type = is_packed_color(field) ? ScalarType::kUint32 : *type;
      if (!names.insert(column.name).second) {
        throw std::invalid_argument("PCL field '" + column.name +
                                    "' is there twice, expected different names");
      }
      header.fields.push_back(column);
      views.push_back({first + field.offset + k * size_of(*type), layout.stride});
    }
  }
  for (const char* axis : {"x", "y", "z"}) {
    if (names.count(axis) == 0) {
      throw std::invalid_argument(std::string("PCL cloud: found no field '") + axis +
                                  "', expected x, y and z");
    }
  }
  CloudBuilder builder(header, false);
  for (std::size_t start = 0; start < layout.count; start += kBatchSize) {
    PointBatch batch;
    batch.count = std::min(kBatchSize, layout.count - start);
    batch.fields = views;
    for (FieldView& view : batch.fields) view.data += start * layout.stride;
    builder.add(batch);
  }
  ReadReport report;
  return builder.finish(report);
}

void fill_pcl_points(const RoadCloud& cloud, const PclPoints& layout, void* data) {
  const std::vector<Attribute> attributes = attributes_of(cloud);
  if (layout.count == 0) return;
  auto* const first = static_cast<unsigned char*>(data);
  for (const PCLPointField& field : layout.fields) {
    const bool color = is_packed_color(field);
    const auto from =
        std::find_if(attributes.begin(), attributes.end(), [&](const Attribute& attribute) {
          return color ? attribute.color : attribute.name == field.name;
        });
    const std::optional<ScalarType> type = scalar_type(field);
    if (from == attributes.end() || !type || field.count > 1) continue;
    unsigned char* to = first + field.offset;
    if (color) {
      for (std::size_t i = 0; i < layout.count; ++i, to += layout.stride) {
        const std::uint32_t packed = packed_color(from->values, i);
        std::memcpy(to, &packed, sizeof packed);
      }
      continue;
    }
    const ScalarType source =
        from->type == PCLPointField::INT32 ? ScalarType::kInt32 : ScalarType::kFloat32;
    with_type(*type, [&](auto tag) {
      for (std::size_t i = 0; i < layout.count; ++i, to += layout.stride) {
        const auto value = converted<decltype(tag)>(from->values.number(source, i));
        std::memcpy(to, &value, sizeof value);
      }
    });
  }
}

}  // namespace detail

pcl::PCLPointCloud2 to_pcl_blob(const RoadCloud& cloud) {
  pcl::PCLPointCloud2 out;
  std::uint32_t offset = 0;
  for (const Attribute& attribute : attributes_of(cloud)) {
    PCLPointField field;
    field.name = attribute.name;
    field.offset = offset;
    field.datatype = attribute.type;
    field.count = 1;
    out.fields.push_back(field);
    offset += 4;
  }
  out.height = 1;
  out.width = static_cast<pcl::uindex_t>(cloud.size());
  out.point_step = offset;
  out.row_step = out.point_step * out.width;
  out.data.resize(static_cast<std::size_t>(offset) * cloud.size());
  out.is_dense = std::all_of(cloud.points.begin(), cloud.points.end(),
                             [](const Eigen::Vector3f& p) { return p.allFinite(); });
  detail::fill_pcl_points(cloud, {out.fields, offset, cloud.size()}, out.data.data());
  return out;
}

RoadCloud from_pcl(const pcl::PCLPointCloud2& cloud) {
  if (cloud.is_bigendian != BOOST_ENDIAN_BIG_BYTE) {
    throw std::invalid_argument("PCL cloud: found the other byte order, expected this machine's");
  }
  const std::size_t row = static_cast<std::size_t>(cloud.point_step) * cloud.width;
  const std::size_t count = static_cast<std::size_t>(cloud.width) * cloud.height;
  const std::size_t pitch = std::max<std::size_t>(cloud.row_step, row);
  if (cloud.height > 0 && cloud.data.size() < pitch * (cloud.height - 1) + row) {
    throw std::invalid_argument(fmt::format("PCL cloud: found {} bytes, expected {} points of {}",
                                            cloud.data.size(), count, cloud.point_step));
  }
  const detail::PclPoints layout{cloud.fields, cloud.point_step, count};
  if (pitch == row || cloud.height <= 1) return detail::read_pcl_points(layout, cloud.data.data());
  std::vector<std::uint8_t> packed;  // without the padding behind the rows
  packed.reserve(row * cloud.height);
  for (std::size_t y = 0; y < cloud.height; ++y) {
    const auto* const begin = cloud.data.data() + y * pitch;
    packed.insert(packed.end(), begin, begin + row);
  }
  return detail::read_pcl_points(layout, packed.data());
}

}  // namespace camber
