#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/coordinate_system.h"

/// Point clouds as streams of batches: what the readers, the writers, `convert` and `filter` are
/// made of. A file of any size passes through a few megabytes of memory.
namespace camber {

struct E57File;
struct LasFile;

enum class ScalarType : std::uint8_t {
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kInt64,
  kUint64,
  kFloat32,
  kFloat64
};

std::size_t size_of(ScalarType type);
inline bool is_float(ScalarType type) { return type >= ScalarType::kFloat32; }

/// Calls function(T{}) for the C++ type of a ScalarType.
template <typename Function>
decltype(auto) with_type(ScalarType type, Function&& function) {
  switch (type) {
    case ScalarType::kInt8:
      return function(std::int8_t{});
    case ScalarType::kUint8:
      return function(std::uint8_t{});
    case ScalarType::kInt16:
      return function(std::int16_t{});
    case ScalarType::kUint16:
      return function(std::uint16_t{});
    case ScalarType::kInt32:
      return function(std::int32_t{});
    case ScalarType::kUint32:
      return function(std::uint32_t{});
    case ScalarType::kInt64:
      return function(std::int64_t{});
    case ScalarType::kUint64:
      return function(std::uint64_t{});
    case ScalarType::kFloat32:
      return function(float{});
    case ScalarType::kFloat64:
      break;
  }
  return function(double{});
}

/// One attribute of a point stream.
struct PointField {
  std::string name;
  ScalarType type = ScalarType::kFloat32;
  /// From text: the values come as double, and the attribute is an integer one if all are whole.
  bool text = false;
  /// Not (or no longer) as in the LAS record that the point comes from.
  bool changed = false;
  /// A float one whose values are all whole numbers from 0 to 65535; where all were looked at.
  bool fits_uint16 = false;
};

/// The values of one field in a batch, in the machine's byte order, at any alignment.
struct FieldView {
  const unsigned char* data = nullptr;
  std::size_t stride = 0;  ///< bytes from one point to the next
  /// Of a text field: some value up to here was written with a decimal point or an exponent.
  bool fractional = false;

  template <typename T>
  T get(std::size_t i) const {
    T value;
    std::memcpy(&value, data + i * stride, sizeof(T));
    return value;
  }
  /// The value as a double, whatever the type.
  double number(ScalarType type, std::size_t i) const {
    return with_type(type, [&](auto tag) { return static_cast<double>(get<decltype(tag)>(i)); });
  }
};

/// Up to kBatchSize points; views are valid until the next call of the source.
struct PointBatch {
  std::size_t count = 0;
  std::vector<FieldView> fields;  ///< parallel to PointStreamHeader::fields
  /// The whole record of each point as its LAS file has it; no data where there is none. The
  /// fields that are not `changed` are as in the record.
  FieldView records;

  void clear() {
    count = 0;
    fields.clear();
    records = {};
  }
};
inline constexpr std::size_t kBatchSize = 8192;

/// The grid that a file's coordinates are on: multiples of `scale` from `offset`, in the units of
/// the axes.
struct PointGrid {
  Eigen::Vector3d scale, offset;
};

struct PointStreamHeader {
  std::vector<PointField> fields;  ///< names are unique
  /// Number of points. Readers have checked it against the file's size; text does not know it.
  std::optional<std::uint64_t> count;
  /// Points for which memory may be taken in advance: of compressed ones the file's size gives
  /// little hint of their number.
  std::uint64_t most_reserved = UINT64_MAX;
  CloudFrame frame = CloudFrame::kUnknown;
  bool metric = true;
  std::optional<Eigen::Vector3d> origin;  ///< recorded by the writer; coordinates include it
  std::optional<PointGrid> grid;          ///< of a LAS file, so that another one keeps it
  /// Of an organised PCD: the points are rows of `width`, `height` of them; 0 of others. Holds as
  /// long as no point is left out.
  std::uint32_t width = 0, height = 0;
  /// Of a PCD: where the sensor stood, x y z and a quaternion w x y z.
  std::optional<std::array<double, 7>> viewpoint;
  std::optional<CoordinateSystem> crs;  ///< where the file, or who reads it, states one
  std::shared_ptr<const LasFile> las;   ///< what a LAS file has beside its points
  std::shared_ptr<const E57File> e57;   ///< what an E57 file has beside its points
  bool records = false;                 ///< batches have the records of `las`
  std::optional<double> full_color;     ///< see GreatestColor; where all points were looked at
  /// Of the finite coordinates, as those of the points or wider; where all points were looked at.
  std::optional<Eigen::AlignedBox3d> bounds;
};

/// Which fields of a stream have a meaning of their own: indices, -1 for none.
struct FieldRoles {
  std::array<int, 3> position{-1, -1, -1};
  std::array<int, 3> color{-1, -1, -1};
  int packed_color = -1;  ///< 0xRRGGBB in 4 bytes
  std::array<int, 3> normal{-1, -1, -1};
  int sigma = -1;
  std::array<int, 6> covariance{-1, -1, -1, -1, -1, -1};
  std::vector<int> others;
};
FieldRoles find_roles(const std::vector<PointField>& fields);

/// Whether a value is a whole number from 0 to 65535.
bool is_uint16(double value);

/// What counts as full in red, green and blue: 255 of bytes, 65535 of 16 bits; nothing where there
/// are none, or where their types leave it open.
std::optional<double> full_color_by_type(const std::vector<PointField>& fields);

/// The greatest of the values of red, green and blue, batch by batch.
class GreatestColor {
 public:
  explicit GreatestColor(const std::vector<PointField>& fields);
  void add(const PointBatch& batch);
  /// What counts as full then: 1 of fractions up to it, 255 up to it, else 65535.
  double full_color() const;

 private:
  std::vector<PointField> fields_;
  std::array<int, 3> color_;
  bool fractions_ = false;
  double greatest_ = 0.0;
};

/// A value of red, green or blue in 8 bits, where `full` is what counts as full.
std::uint8_t color_byte(double value, double full);

/// A cloud being read.
class PointSource {
 public:
  virtual ~PointSource() = default;
  const PointStreamHeader& header() const { return header_; }
  /// Counts so far; complete once next() has returned false.
  const ReadReport& report() const { return report_; }
  /// The next batch; false, after all checks of the file's tail, at the end.
  virtual bool next(PointBatch& batch) = 0;
  /// Triangles of a PLY read with ReadOptions::triangles, complete at the end.
  std::vector<std::array<std::uint32_t, 3>>& triangles() { return triangles_; }

 protected:
  PointStreamHeader header_;
  ReadReport report_;
  std::vector<std::array<std::uint32_t, 3>> triangles_;
};

/// Opens a cloud file and reads its header. @throws InputError.
std::unique_ptr<PointSource> open_point_source(const std::filesystem::path& path,
                                               const ReadOptions& options = {});
/// The same in memory; `data` must outlive the source.
std::unique_ptr<PointSource> open_point_source(const void* data, std::size_t size,
                                               const std::string& name,
                                               const ReadOptions& options = {});

/// A RoadCloud as a stream, true coordinates (double if it has an origin); it must outlive it.
std::unique_ptr<PointSource> make_point_source(const RoadCloud& cloud);

/// Points of a LAS file in another order, or some of them, with all that their records hold.
/// @param header  of the file's source, with `las`
/// @param records the file's records, one behind the other; taken over
/// @param order   which of them, in their new order
std::unique_ptr<PointSource> make_las_rows(const PointStreamHeader& header, std::string records,
                                           std::vector<int> order);

/// A cloud being written. Call write() for each batch, then finish().
class PointSink {
 public:
  virtual ~PointSink() = default;
  virtual void write(const PointBatch& batch) = 0;
  virtual void finish() = 0;
  /// What was written in another way than a user may expect, one sentence each; after finish().
  virtual std::vector<std::string> notes() const { return {}; }
};

/// @param out    must be seekable unless header.count is given.
/// @param beside the file that is written: what does not fit into memory is put into its folder for
///               the time (COPC alone); empty: into that of the system's temporary files
std::unique_ptr<PointSink> make_point_sink(std::ostream& out, const PointStreamHeader& header,
                                           CloudFormat format, CloudEncoding encoding,
                                           const std::filesystem::path& beside = {});

/// The encoding to write a file with: commas for text in a file that ends in .csv, an octree for
/// LAZ in one that ends in .copc.laz.
CloudEncoding encoding_for(const std::filesystem::path& path, CloudFormat format,
                           CloudEncoding asked);

/// Collects batches into a RoadCloud, choosing its origin from the first one.
class CloudBuilder {
 public:
  /// @param wanted  attributes to collect beside the coordinates, see ReadOptions
  CloudBuilder(const PointStreamHeader& header, bool lenient, const ReadOptions& wanted = {});
  ~CloudBuilder();
  void add(const PointBatch& batch);
  /// The cloud; counts what it finds (and, if lenient, drops) in the report.
  RoadCloud finish(ReadReport& report);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace camber
