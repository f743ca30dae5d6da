#include "camber/cloud/point_stream.h"

#include <sys/mman.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>

#include "camber/cloud/las_names.h"
#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber {

std::size_t size_of(ScalarType type) {
  return with_type(type, [](auto tag) { return sizeof(tag); });
}

void ReadReport::drop(const std::string& reason, std::uint64_t count) {
  if (count == 0) return;
  for (auto& [known, total] : dropped) {
    if (known == reason) {
      total += count;
      return;
    }
  }
  dropped.emplace_back(reason, count);
}

FieldRoles find_roles(const std::vector<PointField>& fields) {
  FieldRoles roles;
  std::vector<bool> used(fields.size(), false);
  // An exact name goes before the same in capitals, whatever the order.
  const auto find = [&](std::initializer_list<const char*> names) {
    for (const char* name : names) {
      for (std::size_t i = 0; i < fields.size(); ++i) {
        if (!used[i] && fields[i].name == name) return static_cast<int>(i);
      }
    }
    for (const char* name : names) {
      for (std::size_t i = 0; i < fields.size(); ++i) {
        if (!used[i] && lower_case(fields[i].name) == name) return static_cast<int>(i);
      }
    }
    return -1;
  };
  const auto take = [&](int index) {
    if (index >= 0) used[static_cast<std::size_t>(index)] = true;
  };
  const auto take_all = [&](auto& group, const auto& found) {
    if (std::find(found.begin(), found.end(), -1) != found.end()) return;
    group = found;
    for (const int index : found) take(index);
  };
  roles.position = {find({"x"}), find({"y"}), find({"z"})};
  for (const int index : roles.position) take(index);
  using Three = std::array<int, 3>;
  take_all(roles.color,
           Three{find({"red", "r", "diffuse_red"}), find({"green", "g", "diffuse_green"}),
                 find({"blue", "b", "diffuse_blue"})});
  if (roles.color[0] < 0) {
    const int packed = find({"rgb", "rgba"});
    if (packed >= 0 && !is_float(fields[static_cast<std::size_t>(packed)].type) &&
        size_of(fields[static_cast<std::size_t>(packed)].type) == 4) {
      roles.packed_color = packed;
      take(packed);
    }
  }
  const Three normal{find({"nx", "normal_x"}), find({"ny", "normal_y"}), find({"nz", "normal_z"})};
  take_all(roles.normal, normal);
  roles.sigma = find({"sigma"});
  take(roles.sigma);
  take_all(roles.covariance,
           std::array<int, 6>{find({"cov_xx"}), find({"cov_xy"}), find({"cov_xz"}),
                              find({"cov_yy"}), find({"cov_yz"}), find({"cov_zz"})});
  for (std::size_t i = 0; i < fields.size(); ++i) {
    if (!used[i]) roles.others.push_back(static_cast<int>(i));
  }
  return roles;
}

bool is_uint16(double value) {
  return value >= 0.0 && value <= 65535.0 && value == std::floor(value);
}

std::optional<double> full_color_by_type(const std::vector<PointField>& fields) {
  const FieldRoles roles = find_roles(fields);
  if (roles.color[0] < 0) return {};
  const auto all = [&](auto&& good) {
    return std::all_of(roles.color.begin(), roles.color.end(), [&](int field) {
      return good(fields[static_cast<std::size_t>(field)].type);
    });
  };
  if (all([](ScalarType type) { return size_of(type) == 1; })) return 255.0;
  if (all([](ScalarType type) { return type == ScalarType::kUint16; })) return 65535.0;
  return {};
}

GreatestColor::GreatestColor(const std::vector<PointField>& fields)
    : fields_(fields), color_(find_roles(fields).color) {}

void GreatestColor::add(const PointBatch& batch) {
  if (color_[0] < 0) return;
  for (const int c : color_) {
    const PointField& field = fields_[static_cast<std::size_t>(c)];
    const FieldView& view = batch.fields[static_cast<std::size_t>(c)];
    fractions_ = fractions_ || (field.text ? view.fractional : is_float(field.type));
    for (std::size_t i = 0; i < batch.count; ++i) {
      const double value = view.number(field.type, i);
      if (value > greatest_) greatest_ = value;
    }
  }
}

double GreatestColor::full_color() const {
  if (greatest_ > 255.0) return 65535.0;
  return fractions_ && greatest_ <= 1.0 ? 1.0 : 255.0;
}

std::uint8_t color_byte(double value, double full) {
  // CloudBuilder collects floats: all are rounded alike.
  const double v = static_cast<double>(static_cast<float>(value));
  const double byte = full > 255.0 ? std::floor(v / 256.0) : full <= 1.0 ? v * 255.0 : v;
  return static_cast<std::uint8_t>(std::clamp(std::isnan(byte) ? 0.0 : byte, 0.0, 255.0) + 0.5);
}

// --- CloudBuilder ------------------------------------------------------------------------------

namespace {

/// Reserves memory and asks for large pages, which halves the cost of touching it first.
template <typename T>
void reserve_large(std::vector<T>& values, std::size_t count) {
  values.reserve(count);
  constexpr std::uintptr_t kPage = std::uintptr_t{1} << 21;
  const std::uintptr_t begin = reinterpret_cast<std::uintptr_t>(values.data());
  const std::uintptr_t first = (begin + kPage - 1) / kPage * kPage;
  const std::uintptr_t last = (begin + values.capacity() * sizeof(T)) / kPage * kPage;
  if (first < last) ::madvise(reinterpret_cast<void*>(first), last - first, MADV_HUGEPAGE);
}

constexpr double kLargestLabel = std::numeric_limits<int>::max();
constexpr double kSmallestLabel = std::numeric_limits<int>::min();

/// Integer attribute while all values allow it, then a float one.
struct OtherAttribute {
  int field = -1;
  bool as_label = false;
  std::vector<int> labels;
  std::vector<float> scalars;

  void become_scalar() {
    as_label = false;
    scalars.reserve(labels.capacity());
    scalars.assign(labels.begin(), labels.end());
    labels = {};
  }
};

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Where the coordinates of a first batch are large, the round part of their median.
double round_origin(std::vector<double>& values) {
  constexpr double kLarge = 1000.0, kStep = 1000.0;  // m
  if (values.empty()) return 0.0;
  const double middle = median(values);
  // Beyond this a step of 1000 m is not exact in a double, and no map has such coordinates.
  if (std::abs(middle) < kLarge || std::abs(middle) > 1e12) return 0.0;
  return std::round(middle / kStep) * kStep;
}

double spread(const std::vector<double>& values) {
  if (values.empty()) return 0.0;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return *high - *low;
}

/// Angles, which as floats are up to 0.2 m off: their median, rounded to the power of ten that is
/// not below their spread.
double origin_of_angles(std::vector<double>& values) {
  constexpr double kLeastStep = 1e-6, kFullCircle = 400.0;  // gon, the smallest unit of them
  const double step = std::pow(10.0, std::ceil(std::log10(std::max(spread(values), kLeastStep))));
  const double middle = values.empty() ? 0.0 : median(values);
  return std::abs(middle) > kFullCircle ? round_origin(values) : std::round(middle / step) * step;
}

/// Whether coordinates of no known unit lie together as those of a survey in degrees do: far from
/// zero for their spread. Where they are lengths, an origin does no harm.
bool look_like_angles(std::vector<double>& values) {
  constexpr double kFar = 500.0;
  const double width = spread(values);
  return width > 0.0 && std::abs(median(values)) > kFar * width;
}

/// The roles without those of attributes that are left out.
FieldRoles wanted_roles(const std::vector<PointField>& fields, const ReadOptions& options) {
  FieldRoles roles = find_roles(fields);
  if (!options.attributes) return roles;
  const auto wanted = [&](int field) {
    return field >= 0 && options.wants(fields[static_cast<std::size_t>(field)].name);
  };
  const auto keep = [&](auto& group) {
    if (!std::all_of(group.begin(), group.end(), wanted)) group.fill(-1);
  };
  keep(roles.color);
  keep(roles.normal);
  keep(roles.covariance);
  if (!wanted(roles.packed_color)) roles.packed_color = -1;
  if (!wanted(roles.sigma)) roles.sigma = -1;
  roles.others.erase(std::remove_if(roles.others.begin(), roles.others.end(),
                                    [&](int field) { return !wanted(field); }),
                     roles.others.end());
  return roles;
}

}  // namespace

struct CloudBuilder::State {
  PointStreamHeader header;
  FieldRoles roles;
  bool lenient = false;
  bool started = false;
  RoadCloud cloud;
  std::vector<std::array<float, 3>> wide_colors;  // of more than 8 bits, or fractions
  bool float_colors = false;
  std::vector<OtherAttribute> others;
  std::uint64_t non_finite = 0;
  std::vector<bool> bad_attribute;  // of a batch
  std::uint64_t non_finite_attributes = 0;
  std::uint64_t overflowing = 0;

  ScalarType type(int field) const { return header.fields[static_cast<std::size_t>(field)].type; }

  void start(const PointBatch& batch);
  void add_positions(const PointBatch& batch);
  void add_colors(const PointBatch& batch);
  void add_other(const PointBatch& batch, OtherAttribute& other);
  template <typename Store>
  void add_floats(const PointBatch& batch, int field, Store&& store);
  void drop_bad_points(ReadReport& report);
};

CloudBuilder::CloudBuilder(const PointStreamHeader& header, bool lenient, const ReadOptions& wanted)
    : state_(std::make_unique<State>()) {
  State& s = *state_;
  s.header = header;
  s.lenient = lenient;
  s.roles = wanted_roles(header.fields, wanted);
  s.cloud.frame = header.frame;
  s.cloud.metric = header.metric;
  for (const int field : s.roles.others) {
    OtherAttribute other;
    other.field = field;
    other.as_label =
        !is_float(s.type(field)) || header.fields[static_cast<std::size_t>(field)].text;
    s.others.push_back(std::move(other));
  }
  if (header.count) {
    const auto count = static_cast<std::size_t>(std::min(*header.count, header.most_reserved));
    reserve_large(s.cloud.points, count);
    if (s.roles.packed_color >= 0) reserve_large(s.cloud.colors, count);
    if (s.roles.color[0] >= 0) {
      if (size_of(s.type(s.roles.color[0])) == 1) {
        reserve_large(s.cloud.colors, count);
      } else {
        reserve_large(s.wide_colors, count);
      }
    }
    if (s.roles.normal[0] >= 0) reserve_large(s.cloud.normals, count);
    if (s.roles.sigma >= 0) reserve_large(s.cloud.sigmas, count);
    if (s.roles.covariance[0] >= 0) reserve_large(s.cloud.covariances, count);
    for (OtherAttribute& other : s.others) {
      if (other.as_label) {
        reserve_large(other.labels, count);
      } else {
        reserve_large(other.scalars, count);
      }
    }
  }
}

CloudBuilder::~CloudBuilder() = default;

void CloudBuilder::State::start(const PointBatch& batch) {
  started = true;
  if (header.origin) {
    cloud.origin = *header.origin;
    return;
  }
  std::array<std::vector<double>, 3> values;
  bool doubles = true;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int field = roles.position[axis];
    if (field < 0) continue;
    doubles = doubles && type(field) == ScalarType::kFloat64;
    values[axis].reserve(batch.count);
    for (std::size_t i = 0; i < batch.count; ++i) {
      const double value = batch.fields[static_cast<std::size_t>(field)].number(type(field), i);
      if (std::isfinite(value)) values[axis].push_back(value);
    }
  }
  const bool unknown = !header.crs && header.frame == CloudFrame::kUnknown;
  const bool angles =
      doubles && ((header.crs && header.crs->horizontal.angle) ||
                  (unknown && (look_like_angles(values[0]) || look_like_angles(values[1]))));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    cloud.origin[static_cast<Eigen::Index>(axis)] =
        angles && axis < 2 ? origin_of_angles(values[axis]) : round_origin(values[axis]);
  }
}

void CloudBuilder::State::add_positions(const PointBatch& batch) {
  const std::size_t old = cloud.points.size();
  cloud.points.resize(old + batch.count);
  float* const out = cloud.points[old].data();
  const auto& p = roles.position;
  const bool all_float = p[0] >= 0 && p[1] >= 0 && p[2] >= 0 &&
                         type(p[0]) == ScalarType::kFloat32 && type(p[1]) == ScalarType::kFloat32 &&
                         type(p[2]) == ScalarType::kFloat32;
  if (all_float && cloud.origin.isZero(0.0)) {
    const FieldView x = batch.fields[static_cast<std::size_t>(p[0])];
    const FieldView y = batch.fields[static_cast<std::size_t>(p[1])];
    const FieldView z = batch.fields[static_cast<std::size_t>(p[2])];
    if (y.data == x.data + 4 && z.data == x.data + 8 && y.stride == x.stride &&
        z.stride == x.stride) {
      if (x.stride == 12) {
        std::memcpy(out, x.data, 12 * batch.count);
      } else {
        for (std::size_t i = 0; i < batch.count; ++i) {
          std::memcpy(out + 3 * i, x.data + i * x.stride, 12);
        }
      }
    } else {
      for (std::size_t i = 0; i < batch.count; ++i) {
        out[3 * i] = x.get<float>(i);
        out[3 * i + 1] = y.get<float>(i);
        out[3 * i + 2] = z.get<float>(i);
      }
    }
  } else {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (p[axis] < 0) {
        for (std::size_t i = 0; i < batch.count; ++i) out[3 * i + axis] = 0.0f;
        continue;
      }
      const FieldView view = batch.fields[static_cast<std::size_t>(p[axis])];
      const double origin = cloud.origin[static_cast<Eigen::Index>(axis)];
      with_type(type(p[axis]), [&](auto tag) {
        for (std::size_t i = 0; i < batch.count; ++i) {
          // Beyond the range of float the conversion is to infinity (IEEE 754).
          out[3 * i + axis] =
              static_cast<float>(static_cast<double>(view.template get<decltype(tag)>(i)) - origin);
        }
      });
    }
  }
  // A number times zero is zero unless it is NaN or infinite.
  std::size_t bad = 0;
  for (std::size_t i = 0; i < batch.count; ++i) {
    const float sum = out[3 * i] * 0.0f + out[3 * i + 1] * 0.0f + out[3 * i + 2] * 0.0f;
    bad += sum == 0.0f ? 0 : 1;
  }
  non_finite += bad;
}

void CloudBuilder::State::add_colors(const PointBatch& batch) {
  if (roles.packed_color >= 0) {
    const FieldView view = batch.fields[static_cast<std::size_t>(roles.packed_color)];
    const std::size_t old = cloud.colors.size();
    cloud.colors.resize(old + batch.count);
    for (std::size_t i = 0; i < batch.count; ++i) {
      const std::uint32_t rgb = view.get<std::uint32_t>(i);
      cloud.colors[old + i] = {static_cast<std::uint8_t>(rgb >> 16),
                               static_cast<std::uint8_t>(rgb >> 8), static_cast<std::uint8_t>(rgb)};
    }
  }
  if (roles.color[0] < 0) return;
  const bool bytes = size_of(type(roles.color[0])) == 1 && size_of(type(roles.color[1])) == 1 &&
                     size_of(type(roles.color[2])) == 1;
  if (bytes) {
    const std::size_t old = cloud.colors.size();
    cloud.colors.resize(old + batch.count);
    for (std::size_t c = 0; c < 3; ++c) {
      const FieldView view = batch.fields[static_cast<std::size_t>(roles.color[c])];
      for (std::size_t i = 0; i < batch.count; ++i)
        cloud.colors[old + i][c] = view.get<std::uint8_t>(i);
    }
    return;
  }
  const std::size_t old = wide_colors.size();
  wide_colors.resize(old + batch.count);
  for (std::size_t c = 0; c < 3; ++c) {
    const FieldView view = batch.fields[static_cast<std::size_t>(roles.color[c])];
    const bool text = header.fields[static_cast<std::size_t>(roles.color[c])].text;
    float_colors = float_colors || (text ? view.fractional : is_float(type(roles.color[c])));
    with_type(type(roles.color[c]), [&](auto tag) {
      for (std::size_t i = 0; i < batch.count; ++i) {
        wide_colors[old + i][c] = static_cast<float>(view.template get<decltype(tag)>(i));
      }
    });
  }
}

template <typename Store>
void CloudBuilder::State::add_floats(const PointBatch& batch, int field, Store&& store) {
  const FieldView view = batch.fields[static_cast<std::size_t>(field)];
  with_type(type(field), [&](auto tag) {
    using T = decltype(tag);
    bool bad = false;
    for (std::size_t i = 0; i < batch.count; ++i) {
      const T value = view.template get<T>(i);
      if constexpr (std::is_floating_point_v<T>) bad |= !(value * T{0} == T{0});
      store(i, static_cast<float>(value));
    }
    if constexpr (std::is_floating_point_v<T>) {
      if (!bad) return;
      bad_attribute.resize(batch.count);
      for (std::size_t i = 0; i < batch.count; ++i) {
        if (!std::isfinite(view.template get<T>(i))) bad_attribute[i] = true;
      }
    }
  });
}

void CloudBuilder::State::add_other(const PointBatch& batch, OtherAttribute& other) {
  const FieldView view = batch.fields[static_cast<std::size_t>(other.field)];
  if (other.as_label && view.fractional) other.become_scalar();
  if (other.as_label) {
    with_type(type(other.field), [&](auto tag) {
      using T = decltype(tag);
      const std::size_t old = other.labels.size();
      other.labels.resize(old + batch.count);
      bool fits = true;
      for (std::size_t i = 0; i < batch.count; ++i) {
        const T value = view.template get<T>(i);
        if constexpr (sizeof(T) >= 4 && !std::is_same_v<T, std::int32_t>) {
          const double number = static_cast<double>(value);
          const bool good = number >= kSmallestLabel && number <= kLargestLabel &&
                            static_cast<double>(static_cast<int>(number)) == number;
          fits = fits && good;
          other.labels[old + i] = good ? static_cast<int>(number) : 0;
        } else {
          other.labels[old + i] = static_cast<int>(value);
        }
      }
      if (!fits) {
        other.labels.resize(old);
        other.become_scalar();
      }
    });
    if (other.as_label) return;
  }
  const std::size_t old = other.scalars.size();
  other.scalars.resize(old + batch.count);
  add_floats(batch, other.field, [&](std::size_t i, float v) { other.scalars[old + i] = v; });
}

void CloudBuilder::add(const PointBatch& batch) {
  State& s = *state_;
  if (batch.count == 0) return;
  if (!s.started) s.start(batch);
  s.bad_attribute.clear();
  RoadCloud& cloud = s.cloud;
  const std::size_t old = cloud.points.size();
  const std::size_t total = old + batch.count;
  s.add_positions(batch);
  s.add_colors(batch);
  if (s.roles.normal[0] >= 0) {
    cloud.normals.resize(total);
    for (int axis = 0; axis < 3; ++axis) {
      s.add_floats(batch, s.roles.normal[static_cast<std::size_t>(axis)],
                   [&](std::size_t i, float v) { cloud.normals[old + i][axis] = v; });
    }
  }
  if (s.roles.sigma >= 0) {
    cloud.sigmas.resize(total);
    s.add_floats(batch, s.roles.sigma, [&](std::size_t i, float v) { cloud.sigmas[old + i] = v; });
  }
  if (s.roles.covariance[0] >= 0) {
    cloud.covariances.resize(total);
    for (std::size_t k = 0; k < 6; ++k) {
      s.add_floats(batch, s.roles.covariance[k],
                   [&](std::size_t i, float v) { cloud.covariances[old + i][k] = v; });
    }
  }
  for (OtherAttribute& other : s.others) s.add_other(batch, other);
  if (!s.bad_attribute.empty()) {
    for (std::size_t i = 0; i < batch.count; ++i) {
      if (s.bad_attribute[i] && cloud.points[old + i].allFinite()) ++s.non_finite_attributes;
    }
  }
}

void CloudBuilder::State::drop_bad_points(ReadReport& report) {
  constexpr float kLargest = 1e9f;  // m; no map coordinate is larger
  struct Hash {
    std::size_t operator()(const std::array<std::uint32_t, 3>& p) const {
      std::uint64_t h = 0;
      for (const std::uint32_t v : p) h = (h ^ v) * 0x9E3779B97F4A7C15ull, h ^= h >> 29;
      return static_cast<std::size_t>(h);
    }
  };
  std::unordered_map<std::array<std::uint32_t, 3>, int, Hash> seen;
  seen.reserve(cloud.size());
  std::vector<int> kept;
  kept.reserve(cloud.size());
  std::uint64_t not_finite = 0, out_of_range = 0, duplicate = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.points[i];
    if (!p.allFinite()) {
      ++not_finite;
    } else if (p.cwiseAbs().maxCoeff() > kLargest) {
      ++out_of_range;
    } else {
      std::array<std::uint32_t, 3> key;
      const Eigen::Vector3f q = p + Eigen::Vector3f::Zero();  // -0 becomes 0
      std::memcpy(key.data(), q.data(), 12);
      if (seen.emplace(key, 0).second) {
        kept.push_back(static_cast<int>(i));
      } else {
        ++duplicate;
      }
    }
  }
  report.drop("not finite", not_finite);
  report.drop("out of range", out_of_range);
  report.drop("duplicate", duplicate);
  if (kept.size() < cloud.size()) cloud = cloud.select(kept);
}

RoadCloud CloudBuilder::finish(ReadReport& report) {
  State& s = *state_;
  if (!s.wide_colors.empty()) {
    float largest = 0.0f;
    for (const auto& color : s.wide_colors) {
      for (const float c : color) largest = c > largest ? c : largest;
    }
    // 16 bits a channel, fractions of one, or bytes in wider types. Where these are some points of
    // a file, all of its points decide.
    const double full = s.header.full_color.value_or(largest > 255.0f                    ? 65535.0
                                                     : s.float_colors && largest <= 1.0f ? 1.0
                                                                                         : 255.0);
    reserve_large(s.cloud.colors, s.wide_colors.size());
    for (const auto& color : s.wide_colors) {
      s.cloud.colors.push_back(
          {color_byte(color[0], full), color_byte(color[1], full), color_byte(color[2], full)});
    }
    s.wide_colors = {};
  }
  for (OtherAttribute& other : s.others) {
    const std::string& name = s.header.fields[static_cast<std::size_t>(other.field)].name;
    if (other.as_label) {
      s.cloud.labels[name] = std::move(other.labels);
    } else {
      s.cloud.scalars[name] = std::move(other.scalars);
    }
  }
  report.non_finite = s.non_finite;
  report.non_finite_attributes = s.non_finite_attributes;
  if (s.lenient) s.drop_bad_points(report);
  report.points = s.cloud.size();
  return std::move(s.cloud);
}

// --- RoadCloud as a source ---------------------------------------------------------------------

namespace {

class CloudSource : public PointSource {
 public:
  explicit CloudSource(const RoadCloud& cloud) : cloud_(cloud) {
    cloud.validate();
    header_.count = cloud.size();
    header_.frame = cloud.frame;
    header_.metric = cloud.metric;
    shifted_ = !cloud.origin.isZero(0.0);
    if (shifted_) header_.origin = cloud.origin;
    Eigen::AlignedBox3d bounds;
    for (const Eigen::Vector3f& p : cloud.points) {
      for (int axis = 0; axis < 3; ++axis) {
        const double x = cloud.origin[axis] + static_cast<double>(p[axis]);
        if (!std::isfinite(x)) continue;
        bounds.min()[axis] = std::min(bounds.min()[axis], x);
        bounds.max()[axis] = std::max(bounds.max()[axis], x);
      }
    }
    header_.bounds = bounds;
    report_.declared = cloud.size();
    const char* const axes[] = {"x", "y", "z"};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (shifted_) {
        add(axes[axis], ScalarType::kFloat64, nullptr, 24);
      } else {
        add(axes[axis], ScalarType::kFloat32,
            cloud.empty() ? nullptr : cloud.points[0].data() + axis, 12);
      }
    }
    const char* const channels[] = {"red", "green", "blue"};
    for (std::size_t c = 0; c < 3 && !cloud.colors.empty(); ++c) {
      add(channels[c], ScalarType::kUint8, cloud.colors[0].data() + c, 3);
    }
    const char* const normals[] = {"nx", "ny", "nz"};
    for (std::size_t axis = 0; axis < 3 && !cloud.normals.empty(); ++axis) {
      add(normals[axis], ScalarType::kFloat32, cloud.normals[0].data() + axis, 12);
    }
    if (!cloud.sigmas.empty()) add("sigma", ScalarType::kFloat32, cloud.sigmas.data(), 4);
    const char* const covariance[] = {"cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz"};
    for (std::size_t k = 0; k < 6 && !cloud.covariances.empty(); ++k) {
      add(covariance[k], ScalarType::kFloat32, cloud.covariances[0].data() + k, 24);
    }
    for (const auto& [name, values] : cloud.labels) add(name, ScalarType::kInt32, values.data(), 4);
    for (const auto& [name, values] : cloud.scalars) {
      add(name, ScalarType::kFloat32, values.data(), 4);
      header_.fields.back().fits_uint16 = las_attribute(name) == "intensity" &&
                                          std::all_of(values.begin(), values.end(), is_uint16);
    }
    for (std::size_t i = 0; i < header_.fields.size(); ++i) {
      if (header_.fields[i].name.empty()) {
        throw std::invalid_argument("cloud attribute '' has no name, expected one");
      }
      for (std::size_t k = 0; k < i; ++k) {
        if (header_.fields[i].name == header_.fields[k].name) {
          throw std::invalid_argument("cloud attribute '" + header_.fields[i].name +
                                      "' is there twice, expected different names");
        }
      }
    }
  }

  bool next(PointBatch& batch) override {
    const std::size_t count = std::min(kBatchSize, cloud_.size() - position_);
    batch.count = count;
    batch.fields = views_;
    if (count == 0) return false;
    for (FieldView& view : batch.fields) view.data += position_ * view.stride;
    if (shifted_) {
      true_.resize(3 * count);
      for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
          true_[3 * i + axis] =
              cloud_.origin[static_cast<Eigen::Index>(axis)] +
              static_cast<double>(cloud_.points[position_ + i][static_cast<Eigen::Index>(axis)]);
        }
      }
      for (std::size_t axis = 0; axis < 3; ++axis) {
        batch.fields[axis].data = reinterpret_cast<const unsigned char*>(true_.data() + axis);
      }
    }
    position_ += count;
    report_.points = position_;
    return true;
  }

 private:
  void add(const std::string& name, ScalarType type, const void* data, std::size_t stride) {
    PointField field;
    field.name = name;
    field.type = type;
    header_.fields.push_back(field);
    views_.push_back({static_cast<const unsigned char*>(data), stride});
  }

  const RoadCloud& cloud_;
  bool shifted_ = false;
  std::size_t position_ = 0;
  std::vector<FieldView> views_;
  std::vector<double> true_;
};

}  // namespace

std::unique_ptr<PointSource> make_point_source(const RoadCloud& cloud) {
  return std::make_unique<CloudSource>(cloud);
}

}  // namespace camber
