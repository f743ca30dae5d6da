#include "camber/export/road_mesh.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/export/trajectory.h"
#include "camber/image/image_io.h"
#include "camber/import/formats/trajectory.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Eigen::Vector3d;

/// A plane 3 m to either side of the x axis, with a hole at x = 10 to 11.5 and y > 1.
class HoledGround : public HeightSource {
 public:
  GroundSample at(const Vector3d& place) const override {
    GroundSample sample;
    if (std::abs(place.y()) > 3.05) return sample;
    if (place.x() > 10.0 && place.x() < 11.5 && place.y() > 1.0 && place.y() < 1.7) return sample;
    sample.height = 7.0 + 0.1 * place.x() - 0.05 * place.y();
    return sample;
  }
  double resolution() const override { return 0.5; }
};

RoadMesh plane_mesh() {
  return make_road_mesh(HoledGround(), SmoothLine({{0, 0, 7}, {20, 0, 9}}, 0.01), nullptr, {});
}

TEST(RoadMesh, IsOneSurfaceWithoutHoles) {
  const RoadMesh mesh = plane_mesh();
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = t[static_cast<std::size_t>(k)],
                          b = t[static_cast<std::size_t>((k + 1) % 3)];
      ++edges[{std::min(a, b), std::max(a, b)}];
    }
  }
  std::size_t open = 0;
  for (const auto& [edge, count] : edges) {
    ASSERT_LE(count, 2);
    open += count == 1;
  }
  const std::size_t rows = mesh.points.size() / mesh.columns;
  EXPECT_EQ(open, 2 * (rows - 1) + 2 * (mesh.columns - 1));  // the outer edge alone
  const auto euler = static_cast<long>(mesh.points.size()) - static_cast<long>(edges.size()) +
                     static_cast<long>(mesh.triangles.size());
  EXPECT_EQ(euler, 1);  // a disc
  const Vector3d up = Vector3d(-0.1, 0.05, 1.0).normalized();
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const Vector3d& p = mesh.points[i];
    EXPECT_NEAR(p.z(), 7.0 + 0.1 * p.x() - 0.05 * p.y(), 1e-9);
    EXPECT_NEAR((mesh.normals[i] - up).norm(), 0.0, 1e-9);
  }
  EXPECT_THROW(
      make_road_mesh(HoledGround(), SmoothLine({{0, 50, 7}, {20, 50, 9}}, 0.01), nullptr, {}),
      NoAnswerError);
}

TEST(RoadMesh, PlyReadsBack) {
  RoadMesh mesh = plane_mesh();
  mesh.colors.assign(mesh.points.size(), {10, 20, 30});
  const std::string bytes = encode_ply(mesh);
  ReadOptions options;
  options.triangles = true;
  const CloudFile file = read_cloud_memory(bytes.data(), bytes.size(), "mesh.ply", options);
  ASSERT_EQ(file.cloud.size(), mesh.points.size());
  ASSERT_EQ(file.triangles.size(), mesh.triangles.size());
  ASSERT_EQ(file.cloud.normals.size(), mesh.points.size());
  EXPECT_EQ(file.cloud.colors[5], (std::array<std::uint8_t, 3>{10, 20, 30}));
  for (std::size_t i = 0; i < mesh.points.size(); i += 17) {
    EXPECT_NEAR((file.cloud.origin + file.cloud.points[i].cast<double>() - mesh.points[i]).norm(),
                0.0, 1e-5);
  }
}

TEST(RoadMesh, ObjCountsFromOne) {
  const RoadMesh mesh = plane_mesh();
  std::istringstream lines(encode_obj(mesh));
  std::string line;
  std::map<std::string, std::size_t> kinds;
  while (std::getline(lines, line)) {
    ++kinds[line.substr(0, line.find(' '))];
    if (line[0] != 'f' || kinds["f"] > 1) continue;
    const auto& t = mesh.triangles.front();
    EXPECT_EQ(line, "f " + std::to_string(t[0] + 1) + "//" + std::to_string(t[0] + 1) + " " +
                        std::to_string(t[1] + 1) + "//" + std::to_string(t[1] + 1) + " " +
                        std::to_string(t[2] + 1) + "//" + std::to_string(t[2] + 1));
  }
  EXPECT_EQ(kinds["v"], mesh.points.size());
  EXPECT_EQ(kinds["vn"], mesh.points.size());
  EXPECT_EQ(kinds["f"], mesh.triangles.size());
}

TEST(RoadMesh, GlbHoldsTogether) {
  RoadMesh mesh = plane_mesh();
  mesh.colors.assign(mesh.points.size(), {0, 128, 255});
  const std::string glb = encode_glb(mesh);
  const auto word = [&](std::size_t at) {
    std::uint32_t value = 0;
    std::memcpy(&value, glb.data() + at, 4);
    return value;
  };
  EXPECT_EQ(glb.substr(0, 4), "glTF");
  EXPECT_EQ(word(8), glb.size());
  const nlohmann::json document = nlohmann::json::parse(glb.substr(20, word(12)));
  const std::size_t data = 28 + word(12);
  EXPECT_EQ(word(20 + word(12)) + data, glb.size());
  std::size_t end = 0;
  for (const auto& view : document["bufferViews"]) {
    EXPECT_EQ(view["byteOffset"].get<std::size_t>(), end);  // one behind the other
    end += view["byteLength"].get<std::size_t>();
  }
  EXPECT_EQ(document["buffers"][0]["byteLength"].get<std::size_t>(), end);
  // The second point, in glTF's frame and relative to the first.
  float p[3];
  std::memcpy(p, glb.data() + data + 12, sizeof p);
  const Vector3d d = mesh.points[1] - mesh.points[0];
  EXPECT_NEAR(p[0], -d.y(), 1e-6);
  EXPECT_NEAR(p[1], d.z(), 1e-6);
  EXPECT_NEAR(p[2], -d.x(), 1e-6);
  // Colours of vertices are linear: sRGB's middle grey is a fifth of white.
  const auto& attributes = document["meshes"][0]["primitives"][0]["attributes"];
  const auto& colors = document["accessors"][attributes["COLOR_0"].get<std::size_t>()];
  EXPECT_EQ(colors["componentType"], 5123);  // unsigned short
  EXPECT_TRUE(colors["normalized"].get<bool>());
  const auto& view = document["bufferViews"][colors["bufferView"].get<std::size_t>()];
  EXPECT_EQ(view["byteLength"].get<std::size_t>(), 8 * mesh.points.size());
  std::uint16_t c[4];
  std::memcpy(c, glb.data() + data + view["byteOffset"].get<std::size_t>(), sizeof c);
  EXPECT_EQ(c[0], 0);
  EXPECT_NEAR(c[1] / 65535.0, 0.2158605, 1e-4);  // ((128 / 255 + 0.055) / 1.055)^2.4
  EXPECT_EQ(c[2], 65535);
  EXPECT_EQ(c[3], 65535);
}

/// Points 0.1 m apart on the plane of HoledGround, white lines across it every metre.
RoadCloud striped_cloud() {
  RoadCloud cloud;
  for (int i = 0; i <= 200; ++i) {
    for (int j = -30; j <= 30; ++j) {
      const double x = 0.1 * i, y = 0.1 * j;
      cloud.points.push_back(Vector3d(x, y, 7.0 + 0.1 * x - 0.05 * y).cast<float>());
      cloud.colors.push_back(i % 10 == 0 ? std::array<std::uint8_t, 3>{250, 250, 250}
                                         : std::array<std::uint8_t, 3>{60, 50, 40});
    }
  }
  return cloud;
}

TEST(RoadMesh, ItsTextureIsAsFineAsTheColoursAreKnown) {
  const ColorSource colors(striped_cloud(), PlanFrame());
  const RoadMesh mesh =
      make_road_mesh(HoledGround(), SmoothLine({{0, 0, 7}, {20, 0, 9}}, 0.01), &colors, {});
  const std::size_t sections = mesh.points.size() / mesh.columns;
  ASSERT_GE(mesh.texels, 4);  // 0.5 m of ground, 0.1 m of colours
  EXPECT_EQ(mesh.texture.width, static_cast<int>(mesh.columns - 1) * mesh.texels + 1);
  EXPECT_EQ(mesh.texture.height, static_cast<int>(sections - 1) * mesh.texels + 1);
  const double step = 20.0 / static_cast<double>(sections - 1);
  int stripes = 0;
  for (int row = 0; row < mesh.texture.height; ++row) {
    const double x = step * row / mesh.texels;
    const std::uint8_t* middle =
        &mesh.texture
             .data[3 * static_cast<std::size_t>(row * mesh.texture.width + mesh.texture.width / 2)];
    const double off = std::abs(x - std::round(x));  // from the nearest stripe
    if (off < 0.04) {
      EXPECT_EQ(middle[0], 250) << x;
      ++stripes;
    } else if (off > 0.06) {
      EXPECT_EQ(middle[0], 60) << x;
    }
  }
  EXPECT_GE(stripes, 20);
  // In the file: the picture, and each point at the middle of its texel.
  const std::string glb = encode_glb(mesh);
  std::uint32_t length = 0;
  std::memcpy(&length, glb.data() + 12, 4);
  const nlohmann::json document = nlohmann::json::parse(glb.substr(20, length));
  const auto& primitive = document["meshes"][0]["primitives"][0]["attributes"];
  EXPECT_FALSE(primitive.contains("COLOR_0"));  // it would be multiplied with the texture
  const auto& material = document["materials"][0]["pbrMetallicRoughness"];
  EXPECT_EQ(material["baseColorTexture"]["index"], 0);
  const auto view_of = [&](std::size_t index) {
    const auto& view = document["bufferViews"][index];
    return glb.substr(28 + length + view["byteOffset"].get<std::size_t>(),
                      view["byteLength"].get<std::size_t>());
  };
  const Image picture = decode_color_image(view_of(document["images"][0]["bufferView"]), "texture");
  EXPECT_EQ(picture.data, mesh.texture.data);
  const std::string places =
      view_of(document["accessors"][primitive["TEXCOORD_0"].get<std::size_t>()]["bufferView"]);
  ASSERT_EQ(places.size(), 8 * mesh.points.size());
  float last[2];
  std::memcpy(last, places.data() + places.size() - 8, 8);
  EXPECT_NEAR(last[0] * static_cast<float>(mesh.texture.width),
              static_cast<float>(mesh.texture.width) - 0.5F, 1e-3);
  EXPECT_NEAR(last[1] * static_cast<float>(mesh.texture.height),
              static_cast<float>(mesh.texture.height) - 0.5F, 1e-3);
}

TEST(Trajectory, ReadsBackAsTumAndKitti) {
  std::vector<StampedPose> poses;
  for (int i = 0; i < 5; ++i) {
    StampedPose pose;
    pose.id = 10 + i;
    pose.time_s = 0.1 * i;
    pose.world_from_camera =
        SE3(Eigen::Quaterniond(Eigen::AngleAxisd(0.4 * i, Vector3d(1, 2, 3).normalized())),
            Vector3d(1.0 * i, -0.5, 0.25));
    poses.push_back(pose);
  }
  const test::TemporaryFolder folder;
  for (const bool tum : {true, false}) {
    const fs::path file = folder.path() / (tum ? "poses.tum" : "poses.txt");
    std::ofstream(file) << (tum ? encode_tum(poses) : encode_kitti_poses(poses));
    const PoseFile back = read_poses(file);
    EXPECT_THAT(back.form, ::testing::StartsWith(tum ? "TUM" : "KITTI"));
    ASSERT_EQ(back.poses.size(), poses.size());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      EXPECT_NEAR((back.poses[i].world_from_body().matrix() - poses[i].world_from_camera.matrix())
                      .cwiseAbs()
                      .maxCoeff(),
                  0.0, 1e-8);
      EXPECT_TRUE(!tum || std::abs(back.poses[i].time_s - poses[i].time_s) < 1e-6);
    }
  }
  EXPECT_THAT(encode_pose_csv(poses),
              ::testing::StartsWith("frame,time_s,x_m,y_m,z_m,qx,qy,qz,qw\n10,0.000000,0.0"));
}

}  // namespace
}  // namespace camber
