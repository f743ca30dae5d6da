// COLMAP's sparse models, text and binary: https://colmap.github.io/format.html

#include "camber/cloud/colmap.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

namespace fs = std::filesystem;

struct CameraModel {
  const char* name;
  std::size_t parameters;
};

// By COLMAP's model number.
constexpr CameraModel kModels[] = {
    {"SIMPLE_PINHOLE", 3},
    {"PINHOLE", 4},
    {"SIMPLE_RADIAL", 4},
    {"RADIAL", 5},
    {"OPENCV", 8},
    {"OPENCV_FISHEYE", 8},
    {"FULL_OPENCV", 12},
    {"FOV", 5},
    {"SIMPLE_RADIAL_FISHEYE", 4},
    {"RADIAL_FISHEYE", 5},
    {"THIN_PRISM_FISHEYE", 12},
    {"RAD_TAN_THIN_PRISM_FISHEYE", 16},
};

/// Little-endian values one after the other.
class BinaryReader {
 public:
  explicit BinaryReader(FileReader& file) : file_(file) {}

  template <typename T>
  T take(const char* what) {
    if (!file_.fill(sizeof(T))) {
      file_.fail_at(file_.size(), std::string("found the end of the file, expected ") + what);
    }
    T value;
    std::memcpy(&value, file_.data(), sizeof(T));
    file_.consume(sizeof(T));
    return value;
  }
  double finite(const char* what) {
    const std::uint64_t at = file_.position();
    const double value = take<double>(what);
    if (!std::isfinite(value)) {
      file_.fail_at(
          at, "found " + std::to_string(value) + " for " + what + ", expected a finite number");
    }
    return value;
  }
  /// A number of things of at least `bytes` each, which the file must have room for.
  std::uint64_t count(std::uint64_t bytes, const char* what) {
    const std::uint64_t at = file_.position();
    const std::uint64_t value = take<std::uint64_t>(what);
    if (value > file_.remaining() / bytes) {
      file_.fail_at(at, "found " + std::to_string(value) + " as the number of " + what +
                            ", expected at most " + std::to_string(file_.remaining() / bytes) +
                            " in the rest of the file");
    }
    return value;
  }
  void expect_end() {
    if (file_.remaining() > 0) {
      file_.fail_at(file_.position(),
                    "found " + std::to_string(file_.remaining()) +
                        " bytes behind the last entry, expected the end of the file");
    }
  }

 private:
  FileReader& file_;
};

/// Words of text lines, checked.
class TextReader {
 public:
  explicit TextReader(FileReader& file) : lines_(file) {}

  /// The next line that is neither empty nor a comment; false at the end.
  bool next_line() {
    while (lines_.next(line_)) {
      std::string_view rest = line_;
      const std::string_view word = next_word(rest);
      if (!word.empty() && word[0] != '#') return true;
    }
    return false;
  }
  /// The line directly below, which may be empty.
  bool following_line() { return lines_.next(line_); }
  bool at_end() const {
    std::string_view rest = line_;
    return next_word(rest).empty();
  }
  std::string_view word(const char* what) {
    const std::string_view out = next_word(line_);
    if (out.empty()) fail(std::string("found the end of the line, expected ") + what);
    return out;
  }
  double number(const char* what) {
    const std::string_view text = word(what);
    const ParsedNumber parsed = parse_number(text.data(), text.data() + text.size());
    if (parsed.end != text.data() + text.size() || !std::isfinite(parsed.value)) {
      fail("found " + shown(text) + " for " + what + ", expected a finite number");
    }
    return parsed.value;
  }
  std::int64_t whole(const char* what, double low, double high) {
    const double value = number(what);
    if (std::floor(value) != value || value < low || value > high) {
      std::string text;
      append_number(text, value);
      fail("found " + text + " for " + what + ", expected a whole number in its range");
    }
    return static_cast<std::int64_t>(value);
  }
  std::string_view rest() {
    std::string_view out = line_;
    while (!out.empty() && is_blank(out.front())) out.remove_prefix(1);
    while (!out.empty() && is_blank(out.back())) out.remove_suffix(1);
    return out;
  }
  [[noreturn]] void fail(const std::string& reason) const { lines_.fail(reason); }

 private:
  LineReader lines_;
  std::string_view line_;
};

constexpr std::uint64_t kLeastPoint = 51;  // bytes of a point without observations
constexpr double kLargestId = 4294967295.0, kLargestPointId = 9007199254740992.0;

ColmapPoint read_point(BinaryReader& in) {
  ColmapPoint point;
  point.id = in.take<std::uint64_t>("a point's id");
  for (int axis = 0; axis < 3; ++axis) point.position[axis] = in.take<double>("a coordinate");
  for (std::uint8_t& channel : point.color) channel = in.take<std::uint8_t>("a colour");
  point.error = in.take<double>("a reprojection error");
  const std::uint64_t length = in.count(8, "observations of a point");
  point.track.reserve(static_cast<std::size_t>(length));
  for (std::uint64_t k = 0; k < length; ++k) {
    const std::int32_t image = in.take<std::int32_t>("an image's id");
    point.track.emplace_back(image, in.take<std::int32_t>("a point's index"));
  }
  return point;
}

ColmapPoint read_point(TextReader& in) {
  ColmapPoint point;
  point.id = static_cast<std::uint64_t>(in.whole("a point's id", 0, kLargestPointId));
  for (int axis = 0; axis < 3; ++axis) point.position[axis] = in.number("a coordinate");
  for (std::uint8_t& channel : point.color) {
    channel = static_cast<std::uint8_t>(in.whole("a colour", 0, 255));
  }
  point.error = in.number("a reprojection error");
  while (!in.at_end()) {
    const std::int64_t image = in.whole("an image's id", 0, 2147483647.0);
    point.track.emplace_back(
        static_cast<std::int32_t>(image),
        static_cast<std::int32_t>(in.whole("a point's index", 0, 2147483647.0)));
  }
  return point;
}

SE3 make_pose(double w, double x, double y, double z, const Eigen::Vector3d& t,
              const std::function<void(const std::string&)>& fail) {
  const Eigen::Quaterniond q(w, x, y, z);
  if (std::abs(q.norm() - 1.0) > 0.1) {
    fail("found a quaternion of length " + std::to_string(q.norm()) + ", expected 1");
  }
  return {q, t};
}

void read_cameras(FileReader& file, bool binary, std::vector<ColmapCamera>& cameras) {
  if (binary) {
    BinaryReader in(file);
    const std::uint64_t count = in.count(24, "cameras");
    for (std::uint64_t i = 0; i < count; ++i) {
      ColmapCamera camera;
      camera.id = in.take<std::uint32_t>("a camera's id");
      const std::uint64_t at = file.position();
      const std::int32_t model = in.take<std::int32_t>("a camera model");
      if (model < 0 || model >= static_cast<std::int32_t>(std::size(kModels))) {
        file.fail_at(at, "found camera model " + std::to_string(model) + ", expected 0 to " +
                             std::to_string(std::size(kModels) - 1));
      }
      camera.model = kModels[model].name;
      camera.width = in.take<std::uint64_t>("a width");
      camera.height = in.take<std::uint64_t>("a height");
      for (std::size_t p = 0; p < kModels[model].parameters; ++p) {
        camera.parameters.push_back(in.finite("a camera parameter"));
      }
      cameras.push_back(std::move(camera));
    }
    in.expect_end();
    return;
  }
  TextReader in(file);
  while (in.next_line()) {
    ColmapCamera camera;
    camera.id = in.whole("a camera's id", 0, kLargestId);
    camera.model = std::string(in.word("a camera model"));
    camera.width = static_cast<std::uint64_t>(in.whole("a width", 0, kLargestId));
    camera.height = static_cast<std::uint64_t>(in.whole("a height", 0, kLargestId));
    const auto model = std::find_if(std::begin(kModels), std::end(kModels),
                                    [&](const CameraModel& m) { return camera.model == m.name; });
    if (model == std::end(kModels)) {
      in.fail("found camera model " + shown(camera.model) +
              ", expected PINHOLE, SIMPLE_RADIAL, ...");
    }
    while (!in.at_end()) camera.parameters.push_back(in.number("a camera parameter"));
    if (camera.parameters.size() != model->parameters) {
      in.fail("found " + std::to_string(camera.parameters.size()) + " parameters, expected " +
              std::to_string(model->parameters) + " for " + camera.model);
    }
    cameras.push_back(std::move(camera));
  }
}

void read_images(FileReader& file, bool binary, std::vector<ColmapImage>& images) {
  if (binary) {
    BinaryReader in(file);
    const std::uint64_t count = in.count(73, "images");
    for (std::uint64_t i = 0; i < count; ++i) {
      ColmapImage image;
      image.id = in.take<std::uint32_t>("an image's id");
      const std::uint64_t at = file.position();
      double q[4];
      for (double& value : q) value = in.finite("a quaternion");
      Eigen::Vector3d t;
      for (int axis = 0; axis < 3; ++axis) t[axis] = in.finite("a translation");
      image.camera_from_world = make_pose(
          q[0], q[1], q[2], q[3], t, [&](const std::string& reason) { file.fail_at(at, reason); });
      image.camera_id = in.take<std::uint32_t>("a camera's id");
      for (char c = in.take<char>("a name"); c != '\0'; c = in.take<char>("a name"))
        image.name += c;
      const std::uint64_t points = in.count(24, "points of an image");
      image.points.reserve(static_cast<std::size_t>(points));
      image.point_ids.reserve(static_cast<std::size_t>(points));
      for (std::uint64_t k = 0; k < points; ++k) {
        const double x = in.take<double>("a pixel");
        const double y = in.take<double>("a pixel");
        image.points.emplace_back(x, y);
        image.point_ids.push_back(in.take<std::int64_t>("a point's id"));
      }
      images.push_back(std::move(image));
    }
    in.expect_end();
    return;
  }
  TextReader in(file);
  while (in.next_line()) {
    ColmapImage image;
    image.id = in.whole("an image's id", 0, kLargestId);
    double q[4];
    for (double& value : q) value = in.number("a quaternion");
    Eigen::Vector3d t;
    for (int axis = 0; axis < 3; ++axis) t[axis] = in.number("a translation");
    image.camera_from_world =
        make_pose(q[0], q[1], q[2], q[3], t, [&](const std::string& reason) { in.fail(reason); });
    image.camera_id = in.whole("a camera's id", 0, kLargestId);
    image.name = std::string(in.rest());
    if (image.name.empty()) in.fail("found the end of the line, expected an image's name");
    if (in.following_line()) {
      while (!in.at_end()) {
        const double x = in.number("a pixel");
        const double y = in.number("a pixel");
        image.points.emplace_back(x, y);
        image.point_ids.push_back(in.whole("a point's id", -1, kLargestPointId));
      }
    }
    images.push_back(std::move(image));
  }
}

void read_points(FileReader& file, bool binary, std::vector<ColmapPoint>& points) {
  if (binary) {
    BinaryReader in(file);
    for (std::uint64_t left = in.count(kLeastPoint, "points"); left > 0; --left) {
      points.push_back(read_point(in));
    }
    in.expect_end();
    return;
  }
  TextReader in(file);
  while (in.next_line()) points.push_back(read_point(in));
}

bool is_binary(const std::string& name) {
  return lower_case(fs::path(name).extension().string()) == ".bin";
}

/// points3D as a stream of points.
class ColmapSource : public FormatSource {
 public:
  ColmapSource(std::unique_ptr<FileReader> file, const ReadOptions& options, bool binary)
      : FormatSource(std::move(file), options), binary_(binary), in_(*file_), text_(*file_) {
    report_.format = CloudFormat::kColmap;
    take_crs({});
    report_.encoding = binary ? "binary" : "text";
    header_.metric = false;
    report_.notes.emplace_back("a COLMAP model has no scale of its own; lengths are in its unit");
    const auto add = [&](const char* name, ScalarType type) {
      PointField field;
      field.name = name;
      field.type = type;
      header_.fields.push_back(field);
      types_.push_back(type);
    };
    for (const char* const axis : {"x", "y", "z"}) add(axis, ScalarType::kFloat64);
    for (const char* const channel : {"red", "green", "blue"}) add(channel, ScalarType::kUint8);
    add("error", ScalarType::kFloat32);
    add("track_length", ScalarType::kInt32);
    add("point_id", ScalarType::kUint64);
    rows_.start(types_);
    if (binary_) {
      left_ = in_.count(kLeastPoint, "points");
      header_.count = left_;
      report_.declared = left_;
    }
  }

  bool next(PointBatch& batch) override {
    rows_.clear();
    while (!rows_.full()) {
      ColmapPoint point;
      if (binary_) {
        if (left_ == 0) break;
        --left_;
        point = read_point(in_);
      } else {
        if (!text_.next_line()) break;
        point = read_point(text_);
      }
      double* const row = rows_.new_row();
      for (int axis = 0; axis < 3; ++axis) row[axis] = point.position[axis];
      for (std::size_t c = 0; c < 3; ++c) row[3 + c] = point.color[c];
      row[6] = point.error;
      row[7] = static_cast<double>(point.track.size());
      row[8] = static_cast<double>(point.id);
      rows_.keep_row();
    }
    rows_.fill(batch);
    report_.points += batch.count;
    if (batch.count == 0 && binary_) in_.expect_end();
    return batch.count > 0;
  }

 private:
  bool binary_;
  BinaryReader in_;
  TextReader text_;
  std::uint64_t left_ = 0;
  std::vector<ScalarType> types_;
  RowBuffer rows_;
};

}  // namespace

std::optional<PinholeCamera> ColmapCamera::pinhole() const {
  constexpr std::uint64_t kLargest = 1 << 24;  // pixels
  const bool simple = model == "SIMPLE_PINHOLE" && parameters.size() == 3;
  if (!simple && !(model == "PINHOLE" && parameters.size() == 4)) return std::nullopt;
  if (width > kLargest || height > kLargest) return std::nullopt;
  PinholeCamera camera;
  camera.width = static_cast<int>(width);
  camera.height = static_cast<int>(height);
  camera.fx = parameters[0];
  camera.fy = simple ? parameters[0] : parameters[1];
  camera.cx = parameters[simple ? 1 : 2] - 0.5;
  camera.cy = parameters[simple ? 2 : 3] - 0.5;
  return camera;
}

RoadCloud ColmapModel::cloud() const {
  RoadCloud out;
  out.metric = false;
  std::vector<int>& lengths = out.labels["track_length"];
  std::vector<float>& errors = out.scalars["error"];
  for (const ColmapPoint& point : points) {
    out.points.push_back(point.position.cast<float>());
    out.colors.push_back(point.color);
    lengths.push_back(static_cast<int>(point.track.size()));
    errors.push_back(static_cast<float>(point.error));
  }
  return out;
}

std::unique_ptr<PointSource> open_colmap_points(std::unique_ptr<FileReader> file,
                                                const ReadOptions& options) {
  const bool binary = is_binary(file->name());
  return std::make_unique<ColmapSource>(std::move(file), options, binary);
}

std::vector<ColmapCamera> parse_colmap_cameras(const void* data, std::size_t size,
                                               const std::string& name) {
  FileReader file(data, size, name);
  std::vector<ColmapCamera> cameras;
  read_cameras(file, is_binary(name), cameras);
  return cameras;
}

std::vector<ColmapImage> parse_colmap_images(const void* data, std::size_t size,
                                             const std::string& name) {
  FileReader file(data, size, name);
  std::vector<ColmapImage> images;
  read_images(file, is_binary(name), images);
  return images;
}

std::vector<ColmapPoint> parse_colmap_points(const void* data, std::size_t size,
                                             const std::string& name) {
  FileReader file(data, size, name);
  std::vector<ColmapPoint> points;
  read_points(file, is_binary(name), points);
  return points;
}

ColmapModel read_colmap_model(const fs::path& folder) {
  std::error_code error;
  const bool binary = fs::exists(folder / "points3D.bin", error);
  const char* const extension = binary ? ".bin" : ".txt";
  const auto path = [&](const char* name) { return folder / (std::string(name) + extension); };
  ColmapModel model;
  FileReader cameras(path("cameras"));
  read_cameras(cameras, binary, model.cameras);
  FileReader images(path("images"));
  read_images(images, binary, model.images);
  FileReader points(path("points3D"));
  read_points(points, binary, model.points);
  return model;
}

}  // namespace camber
