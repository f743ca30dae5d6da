#include "camber/cloud/cloud_summary.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace camber {
namespace {

/// Counts of positive numbers in steps of a 64th of an octave.
class LogHistogram {
 public:
  void add(double value) {
    const double place = 64.0 * (std::log2(std::max(value, 0x1p-60)) + 60.0);
    ++counts_[static_cast<std::size_t>(std::clamp(place, 0.0, 64.0 * 120.0 - 1.0))];
    ++total_;
  }
  double quantile(double share) const {
    const double wanted = share * static_cast<double>(total_);
    double below = 0.0;
    for (std::size_t i = 0; i < counts_.size(); ++i) {
      below += static_cast<double>(counts_[i]);
      if (below >= wanted && below > 0.0) {
        return std::exp2((static_cast<double>(i) + 0.5) / 64.0 - 60.0);
      }
    }
    return std::numeric_limits<double>::quiet_NaN();
  }

 private:
  std::array<std::uint64_t, 64 * 120> counts_{};
  std::uint64_t total_ = 0;
};

void widen(double value, double& minimum, double& maximum) {
  if (!(value >= minimum)) minimum = value;  // also where it is NaN still
  if (!(value <= maximum)) maximum = value;
}

/// Attributes of survey clouds whose values are names of classes, not amounts.
bool is_counted(const PointField& field) {
  if (field.type != ScalarType::kUint8) return false;
  for (const char* const name : {"classification", "return_number", "class_flags"}) {
    if (field.name == name) return true;
  }
  return false;
}

}  // namespace

const char* to_string(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8:
      return "int8";
    case ScalarType::kUint8:
      return "uint8";
    case ScalarType::kInt16:
      return "int16";
    case ScalarType::kUint16:
      return "uint16";
    case ScalarType::kInt32:
      return "int32";
    case ScalarType::kUint32:
      return "uint32";
    case ScalarType::kInt64:
      return "int64";
    case ScalarType::kUint64:
      return "uint64";
    case ScalarType::kFloat32:
      return "float32";
    case ScalarType::kFloat64:
      break;
  }
  return "float64";
}

const char* to_string(CloudFrame frame) {
  return frame == CloudFrame::kCamera ? "camera" : frame == CloudFrame::kZUp ? "z-up" : "unknown";
}

CloudSummary summarise(PointSource& source) {
  CloudSummary out;
  const PointStreamHeader& header = source.header();
  out.frame = header.frame;
  out.metric = header.metric;
  out.origin = header.origin;
  out.crs = header.crs;
  out.las = header.las;
  out.e57 = header.e57;
  for (const PointField& field : header.fields) {
    AttributeSummary attribute;
    attribute.name = field.name;
    attribute.type = to_string(field.type);
    out.attributes.push_back(std::move(attribute));
  }
  const FieldRoles roles = find_roles(header.fields);
  LogHistogram sigmas;
  double sigma_sum = 0.0;
  std::uint64_t sigma_count = 0;
  std::vector<std::vector<std::uint64_t>> byte_counts(header.fields.size());
  for (std::size_t f = 0; f < header.fields.size(); ++f) {
    if (is_counted(header.fields[f])) byte_counts[f].resize(256);
  }
  // Of the distances from the first point, so that large coordinates lose nothing.
  Eigen::Vector3d first = Eigen::Vector3d::Zero(), sum = Eigen::Vector3d::Zero();
  std::uint64_t finite = 0;
  PointBatch batch;
  std::vector<std::array<double, 3>> positions;
  while (source.next(batch)) {
    out.points += batch.count;
    positions.assign(batch.count, {0.0, 0.0, 0.0});
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      AttributeSummary& attribute = out.attributes[f];
      const FieldView view = batch.fields[f];
      const ScalarType type = header.fields[f].type;
      if (batch.count > 0) {
        if (out.points == batch.count) attribute.first = view.number(type, 0);
        attribute.last = view.number(type, batch.count - 1);
      }
      if (!byte_counts[f].empty()) {
        for (std::size_t i = 0; i < batch.count; ++i) ++byte_counts[f][view.get<std::uint8_t>(i)];
      }
      with_type(type, [&](auto tag) {
        for (std::size_t i = 0; i < batch.count; ++i) {
          const double value = static_cast<double>(view.get<decltype(tag)>(i));
          if (!std::isfinite(value)) {
            ++attribute.non_finite;
          } else {
            widen(value, attribute.minimum, attribute.maximum);
          }
        }
      });
      if (static_cast<int>(f) == roles.sigma) {
        for (std::size_t i = 0; i < batch.count; ++i) {
          const double value = view.number(header.fields[f].type, i);
          if (!std::isfinite(value)) continue;
          sigmas.add(value);
          sigma_sum += value;
          ++sigma_count;
        }
      }
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (static_cast<int>(f) != roles.position[axis]) continue;
        for (std::size_t i = 0; i < batch.count; ++i) {
          positions[i][axis] = view.number(header.fields[f].type, i);
        }
      }
    }
    for (const auto& p : positions) {
      if (!std::isfinite(p[0] + p[1] + p[2]) &&
          !(std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]))) {
        ++out.non_finite;
        continue;
      }
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const Eigen::Index a = static_cast<Eigen::Index>(axis);
        widen(p[axis], out.minimum[a], out.maximum[a]);
        if (finite == 0) first[a] = p[axis];
        sum[a] += p[axis] - first[a];
      }
      ++finite;
    }
  }
  if (finite > 0) out.mean = first + sum / static_cast<double>(finite);
  for (std::size_t f = 0; f < byte_counts.size(); ++f) {
    for (std::size_t value = 0; value < byte_counts[f].size(); ++value) {
      const std::uint64_t count = byte_counts[f][value];
      if (count > 0) out.attributes[f].counts[static_cast<int>(value)] = count;
    }
  }
  if (sigma_count > 0) {
    out.sigma_mean = sigma_sum / static_cast<double>(sigma_count);
    out.sigma_median = sigmas.quantile(0.5);
    out.sigma_95 = sigmas.quantile(0.95);
  }
  out.report = source.report();
  out.report.points = out.points;
  out.report.non_finite = out.non_finite;
  return out;
}

}  // namespace camber
