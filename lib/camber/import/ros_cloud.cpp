#include "camber/import/ros_cloud.h"

#include <algorithm>
#include <cstring>

#include "camber/core/errors.h"

namespace camber {
namespace {

ScalarType type_of(const RosPointCloud::Field& field) {
  static const ScalarType kTypes[] = {
      ScalarType::kInt8,  ScalarType::kUint8,  ScalarType::kInt16,   ScalarType::kUint16,
      ScalarType::kInt32, ScalarType::kUint32, ScalarType::kFloat32, ScalarType::kFloat64};
  const bool packed = (field.name == "rgb" || field.name == "rgba") && field.type == 7;
  return packed ? ScalarType::kUint32 : kTypes[field.type - 1];
}

class RosCloudSource : public PointSource {
 public:
  RosCloudSource(const RosBytes& bytes, const RosPointCloud& cloud, const SE3* move)
      : cloud_(cloud) {
    if (move != nullptr) move_ = *move;
    for (const RosPointCloud::Field& field : cloud.fields) {
      const ScalarType type = type_of(field);
      for (std::uint32_t k = 0; k < field.count; ++k) {
        PointField out;
        out.name = field.count > 1 ? field.name + "_" + std::to_string(k) : field.name;
        while (std::any_of(header_.fields.begin(), header_.fields.end(),
                           [&](const PointField& other) { return other.name == out.name; })) {
          out.name += "_";
        }
        out.type = type;
        header_.fields.push_back(out);
        offsets_.push_back(field.offset + k * size_of(type));
      }
    }
    stored_ = header_.fields;
    const FieldRoles roles = find_roles(header_.fields);
    position_ = roles.position;
    normal_ = roles.normal;
    if (position_[0] < 0 || position_[1] < 0) {
      throw InputError(bytes.file, bytes.position, "found a cloud without x and y, expected both");
    }
    for (std::size_t axis = 0; move_ && axis < 3; ++axis) {
      if (position_[axis] < 0) {
        throw InputError(bytes.file, bytes.position, "found a cloud without z, expected it");
      }
      header_.fields[static_cast<std::size_t>(position_[axis])].type = ScalarType::kFloat64;
    }
    header_.count = std::uint64_t{cloud.width} * cloud.height;
    report_.encoding = "PointCloud2";
    report_.declared = *header_.count;
    columns_.resize(header_.fields.size());
  }

  bool next(PointBatch& batch) override {
    batch.clear();
    const std::uint64_t left = *header_.count - done_;
    const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(left, kBatchSize));
    if (count == 0) return false;
    batch.count = count;
    for (std::size_t f = 0; f < stored_.size(); ++f) {
      const std::size_t size = size_of(stored_[f].type);
      std::vector<unsigned char>& column = columns_[f];
      column.resize(count * size);
      for (std::size_t i = 0; i < count; ++i) {
        const std::uint64_t point = done_ + i;
        const unsigned char* const from = cloud_.data + point / cloud_.width * cloud_.row_step +
                                          point % cloud_.width * cloud_.point_step + offsets_[f];
        unsigned char* const to = column.data() + i * size;
        std::memcpy(to, from, size);
        if (cloud_.big_endian) std::reverse(to, to + size);
      }
      batch.fields.push_back({column.data(), size});
    }
    if (move_) move_points(&batch);
    done_ += count;
    report_.points = done_;
    return true;
  }

 private:
  void move_points(PointBatch* batch) {
    moved_.resize(3 * batch->count);
    const auto value = [&](const std::array<int, 3>& fields, std::size_t axis, std::size_t i) {
      const auto f = static_cast<std::size_t>(fields[axis]);
      return batch->fields[f].number(stored_[f].type, i);
    };
    for (std::size_t i = 0; i < batch->count; ++i) {
      const Eigen::Vector3d x =
          *move_ *
          Eigen::Vector3d(value(position_, 0, i), value(position_, 1, i), value(position_, 2, i));
      for (std::size_t axis = 0; axis < 3; ++axis) {
        moved_[3 * i + axis] = x[static_cast<Eigen::Index>(axis)];
      }
    }
    if (normal_[0] >= 0) turn_normals(batch);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      batch->fields[static_cast<std::size_t>(position_[axis])] = {
          reinterpret_cast<const unsigned char*>(moved_.data() + axis), 3 * sizeof(double)};
    }
  }

  void turn_normals(PointBatch* batch) {
    for (const int field : normal_) {
      if (stored_[static_cast<std::size_t>(field)].type != ScalarType::kFloat32) return;
    }
    const Eigen::Matrix3f turn = move_->rotation_matrix().cast<float>();
    for (std::size_t i = 0; i < batch->count; ++i) {
      Eigen::Vector3f n;
      for (int axis = 0; axis < 3; ++axis) {
        n[axis] = batch->fields[static_cast<std::size_t>(normal_[static_cast<std::size_t>(axis)])]
                      .get<float>(i);
      }
      n = turn * n;
      for (int axis = 0; axis < 3; ++axis) {
        const auto f = static_cast<std::size_t>(normal_[static_cast<std::size_t>(axis)]);
        std::memcpy(columns_[f].data() + i * sizeof(float), &n[axis], sizeof(float));
      }
    }
  }

  RosPointCloud cloud_;
  std::optional<SE3> move_;
  std::vector<PointField> stored_;  // as in the message
  std::vector<std::size_t> offsets_;
  std::array<int, 3> position_, normal_;
  std::vector<std::vector<unsigned char>> columns_;
  std::vector<double> moved_;
  std::uint64_t done_ = 0;
};

}  // namespace

std::unique_ptr<PointSource> make_ros_cloud_source(const RosBytes& bytes,
                                                   const RosPointCloud& cloud, const SE3* move) {
  return std::make_unique<RosCloudSource>(bytes, cloud, move);
}

}  // namespace camber
