#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <functional>

#include "camber/cloud/colmap.h"
#include "camber/core/errors.h"
#include "camber/core/folder_files.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/delimited_lines.h"
#include "camber/import/formats/frame_files.h"
#include "camber/import/formats/trajectory.h"
#include "camber/import/import_common.h"
#include "camber/import/text_rows.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kMaxMetres = 1e8;

/// A quaternion that is unit within 0.01, as written.
template <typename Fail>
Eigen::Quaterniond checked(double w, double x, double y, double z, const Fail& fail) {
  const Eigen::Quaterniond out(w, x, y, z);
  if (!(std::abs(out.norm() - 1.0) < 0.01)) {
    fail(fmt::format("found a quaternion of length {:.4g}, expected a unit one", out.norm()));
  }
  return out;
}

TimedPose inverse_of(const TimedPose& pose) {
  const SE3 turned = pose.world_from_body().inverse();
  TimedPose out = pose;
  out.rotation = turned.rotation();
  out.position = turned.translation();
  return out;
}

/// The numbers of a row, of lines with blanks or commas.
std::vector<double> numbers_of(const DelimitedLines& lines, const DelimitedLine& line,
                               std::size_t from) {
  std::vector<double> out;
  for (std::size_t i = from; i < line.fields.size(); ++i) {
    if (i + 1 == line.fields.size() && line.fields[i].empty()) continue;  // a separator at the end
    out.push_back(lines.number(line, i, "a number"));
    if (!(std::abs(out.back()) < 1e20))
      lines.fail(line, i, "found a number beyond 1e20, expected a pose");
  }
  return out;
}

TimedPose matrix_pose(const std::vector<double>& v,
                      const std::function<void(const std::string&)>& fail) {
  Eigen::Matrix3d rotation;
  TimedPose out;
  out.matrix = Eigen::Matrix4d::Identity();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) (*out.matrix)(r, c) = v[static_cast<std::size_t>(4 * r + c)];
    for (int c = 0; c < 3; ++c) rotation(r, c) = v[static_cast<std::size_t>(4 * r + c)];
    out.position[r] = v[static_cast<std::size_t>(4 * r + 3)];
  }
  if (!((rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).norm() < 0.02) ||
      rotation.determinant() < 0) {
    fail("found a 3 x 3 part that is no rotation, expected a rotation and a translation");
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(rotation, Eigen::ComputeFullU | Eigen::ComputeFullV);
  out.rotation = Eigen::Quaterniond(Eigen::Matrix3d(svd.matrixU() * svd.matrixV().transpose()));
  return out;
}

/// Seconds; what cannot be such is ms, us or ns, which ORB-SLAM writes with decimals behind.
double tum_time(const std::string& text, double value) {
  constexpr double kNoSeconds = 1e11;  // the year 5138
  if (!(value >= kNoSeconds)) return value;
  const std::string whole = text.substr(0, text.find('.'));
  if (const auto time = time_from_name(whole)) return *time;
  return value * (value >= 1e17 ? 1e-9 : value >= 1e14 ? 1e-6 : 1e-3);
}

/// TUM: eight columns; KITTI: twelve.
PoseFile rows_of_numbers(const DelimitedLines& lines) {
  PoseFile out;
  const std::size_t columns = lines.lines().front().fields.size();
  out.form = columns == 8 ? "TUM" : "KITTI";
  for (const DelimitedLine& line : lines.lines()) {
    const std::vector<double> v = numbers_of(lines, line, 0);
    if (v.size() != columns) {
      lines.fail(line, fmt::format("found {} numbers, expected {} as in the first row", v.size(),
                                   columns));
    }
    const auto fail = [&](const std::string& reason) { lines.fail(line, reason); };
    TimedPose pose;
    if (columns == 12) {
      pose = matrix_pose(v, fail);
    } else {
      pose.time_s = tum_time(std::string(line.fields[0]), v[0]);
      pose.position = {v[1], v[2], v[3]};
      pose.rotation = checked(v[7], v[4], v[5], v[6], fail);
    }
    if (!(pose.position.cwiseAbs().maxCoeff() < kMaxMetres)) fail("found a position beyond 1e8 m");
    out.poses.push_back(std::move(pose));
  }
  return out;
}

PoseFile one_matrix(const DelimitedLines& lines) {
  std::vector<double> v;
  for (const DelimitedLine& line : lines.lines()) {
    const std::vector<double> row = numbers_of(lines, line, 0);
    if (row.size() != 4 || v.size() >= 16)
      lines.fail(line, fmt::format("found {} numbers, expected 4 rows of 4", row.size()));
    v.insert(v.end(), row.begin(), row.end());
  }
  const DelimitedLine& last = lines.lines().back();
  if (v.size() != 16 && v.size() != 12)
    lines.fail(last, fmt::format("found {} numbers, expected 4 rows of 4", v.size()));
  if (v.size() == 16 && (v[12] != 0 || v[13] != 0 || v[14] != 0 || v[15] != 1)) {
    lines.fail(last, "found another last row than 0 0 0 1, expected a rigid transform");
  }
  PoseFile out;
  out.form = "4 x 4 matrices";
  out.poses.push_back(matrix_pose(v, [&](const std::string& reason) { lines.fail(last, reason); }));
  return out;
}

/// EuRoC: timestamp in ns, p x y z, q w x y z, and more.
PoseFile euroc(const DelimitedLines& lines) {
  PoseFile out;
  out.form = "EuRoC";
  for (const DelimitedLine& line : lines.lines()) {
    if (line.fields.size() < 8)
      lines.fail(line, fmt::format("found {} fields, expected time, p x y z, q w x y z",
                                   line.fields.size()));
    const std::string stamp(line.fields[0]);
    TimedPose pose;
    if (stamp.find_first_not_of("0123456789") != std::string::npos) {
      lines.fail(line, 0,
                 fmt::format("found '{}', expected whole nanoseconds of EuRoC's rows with commas "
                             "(time, p x y z, q w x y z); in TUM's (q x y z w) blanks separate",
                             printable(stamp)));
    }
    pose.time_s = 1e-9 * lines.number(line, 0, "a time in nanoseconds");
    if (const auto time = stamp.size() >= 16 ? time_from_name(stamp) : std::nullopt)
      pose.time_s = *time;
    std::vector<double> v;
    for (std::size_t i = 1; i < 8; ++i) v.push_back(lines.number(line, i, "a number of a pose"));
    pose.position = {v[0], v[1], v[2]};
    pose.rotation = checked(v[3], v[4], v[5], v[6],
                            [&](const std::string& reason) { lines.fail(line, reason); });
    out.poses.push_back(std::move(pose));
  }
  return out;
}

/// timestamp, device, qw, qx, qy, qz, tx, ty, tz: camera from world.
PoseFile kapture(const DelimitedLines& lines) {
  PoseFile out;
  out.form = "kapture";
  for (const DelimitedLine& line : lines.lines()) {
    if (line.fields.size() != 9)
      lines.fail(line, fmt::format("found {} fields, expected timestamp, device, q, t",
                                   line.fields.size()));
    std::vector<double> v;
    for (std::size_t i = 2; i < 9; ++i) v.push_back(lines.number(line, i, "a number of a pose"));
    TimedPose pose;
    pose.time_s = lines.number(line, 0, "a timestamp");
    pose.name = std::string(line.fields[1]);
    pose.rotation = checked(v[0], v[1], v[2], v[3],
                            [&](const std::string& reason) { lines.fail(line, reason); });
    pose.position = {v[4], v[5], v[6]};
    out.poses.push_back(inverse_of(pose));
  }
  return out;
}

PoseFile colmap(const fs::path& path, const std::string& text) {
  PoseFile out;
  out.form = "COLMAP";
  for (const ColmapImage& image : parse_colmap_images(text.data(), text.size(), path.string())) {
    TimedPose pose;
    pose.name = image.name;
    const SE3 world_from_camera = image.camera_from_world.inverse();
    pose.rotation = world_from_camera.rotation();
    pose.position = world_from_camera.translation();
    out.poses.push_back(std::move(pose));
  }
  return out;
}

PoseFile folder_of_matrices(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const fs::path& file : files_in(folder)) {
    if (file.extension() == ".txt") files.push_back(file);
  }
  if (files.empty())
    throw InputError(folder.string(), "found no .txt file, expected one pose a file");
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.string(), b.string());
  });
  PoseFile out;
  out.form = "4 x 4 matrices";
  for (const fs::path& file : files) {
    const DelimitedLines lines(file, separator_of(read_whole_file(file)));
    if (lines.lines().empty())
      throw InputError(file.string(), "found no number, expected a 4 x 4 matrix");
    PoseFile one = one_matrix(lines);
    std::string name = file.stem().string();
    const std::size_t mark = name.rfind(".pose");
    if (mark != std::string::npos) name.resize(mark);
    one.poses[0].name = name;
    out.poses.push_back(std::move(one.poses[0]));
  }
  return out;
}

bool is_number(std::string_view word) {
  double value = 0.0;
  return parse_number(word, &value);
}

}  // namespace

PoseFile read_poses(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) return folder_of_matrices(path);
  const std::string text = read_whole_file(path);
  if (path.extension() == ".bin") return colmap(path, text);
  char separator = separator_of(text);
  if (separator == '\t') separator = ' ';
  std::string plain = text;
  const DelimitedLines lines(path, separator);
  if (lines.lines().empty()) throw InputError(path.string(), "found no pose, expected one a line");
  const DelimitedLine& first = lines.lines().front();
  const std::size_t count = first.fields.size();
  if (separator == ',' && count == 9 && !is_number(first.fields[1])) return kapture(lines);
  if (separator == ',' && count >= 8 && count != 12 && is_number(first.fields[0]))
    return euroc(lines);
  if (separator == ' ' && count == 10 && !is_number(first.fields[9])) return colmap(path, text);
  if (count == 8 || count == 12) return rows_of_numbers(lines);
  if (count == 4) return one_matrix(lines);
  lines.fail(
      first,
      fmt::format(
          "found {} columns, expected poses of TUM (8), KITTI (12), EuRoC, kapture, COLMAP, or "
          "4 x 4 matrices",
          count));
}

}  // namespace camber
