#include "camber/render/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/render/gltf.h"
#include "camber/render/picture_file.h"
#include "picture_content.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::PictureScene;
using ::testing::HasSubstr;
using ::testing::Not;

std::uint32_t number_at(const std::string& bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (int i = 3; i >= 0; --i) {
    value = value << 8 | static_cast<std::uint8_t>(bytes[at + static_cast<std::size_t>(i)]);
  }
  return value;
}

struct Glb {
  json document;
  std::string binary;

  explicit Glb(const std::string& bytes) {
    EXPECT_EQ(bytes.substr(0, 4), "glTF");
    EXPECT_EQ(number_at(bytes, 4), 2u);
    EXPECT_EQ(number_at(bytes, 8), bytes.size());
    const std::size_t length = number_at(bytes, 12);
    EXPECT_EQ(length % 4, 0u);
    EXPECT_EQ(bytes.substr(16, 4), "JSON");
    document = json::parse(bytes.substr(20, length));
    EXPECT_EQ(bytes.substr(24 + length, 4), std::string("BIN\0", 4));
    binary = bytes.substr(28 + length);
    EXPECT_EQ(number_at(bytes, 20 + length), binary.size());
    EXPECT_EQ(document["buffers"][0]["byteLength"], binary.size());
  }

  const json* node(const std::string& name) const {
    for (const json& n : document["nodes"]) {
      if (n["name"] == name) return &n;
    }
    return nullptr;
  }

  std::vector<Eigen::Vector3f> positions(const json& primitive) const {
    const json& accessor = document["accessors"][primitive["attributes"]["POSITION"].get<int>()];
    const json& view = document["bufferViews"][accessor["bufferView"].get<int>()];
    std::vector<Eigen::Vector3f> out(accessor["count"].get<std::size_t>());
    std::memcpy(static_cast<void*>(out.data()),
                binary.data() + view["byteOffset"].get<std::size_t>(),
                out.size() * sizeof(Eigen::Vector3f));
    return out;
  }
};

TEST(Gltf, HoldsTheSceneInMetresWithYUp) {
  const PictureScene scene;
  const std::string bytes = encode_glb(scene.content());
  EXPECT_EQ(bytes, encode_glb(scene.content()));
  const Glb glb(bytes);
  for (const char* name : {"road points", "patches", "patch 0", "vehicles", "car 1", "car 2",
                           "truth", "true vehicle 1", "cameras", "camera 7", "path"}) {
    EXPECT_NE(glb.node(name), nullptr) << name;
  }
  // Every accessor lies within the buffer and has at least as many bytes as it needs.
  for (const json& view : glb.document["bufferViews"]) {
    EXPECT_EQ(view["byteOffset"].get<std::size_t>() % 4, 0u);
    EXPECT_LE(view["byteOffset"].get<std::size_t>() + view["byteLength"].get<std::size_t>(),
              glb.binary.size());
  }
  // The first road point: camera (-5, 1.33, 4) is 5 m left, 0.32 m above the road at the camera
  // (1.65 m below it), 4 m ahead; glTF's axes are right, up, back.
  const json& mesh = glb.document["meshes"][(*glb.node("road points"))["mesh"].get<int>()];
  const auto points = glb.positions(mesh["primitives"][0]);
  ASSERT_EQ(points.size(), scene.cloud.size());
  EXPECT_LT((points[0] - Eigen::Vector3f(-5.0f, 0.32f, -4.0f)).norm(), 1e-5f);
}

TEST(Gltf, NamesItsOriginInTheInputsCoordinates) {
  const auto origin = [](const PictureContent& content) {
    const std::vector<double> values =
        Glb(encode_glb(content)).document["asset"]["extras"]["origin"];
    return Eigen::Vector3d(values[0], values[1], values[2]);
  };
  const PictureScene scene;  // the road under the camera
  EXPECT_LT((origin(scene.content()) - Eigen::Vector3d(0, 1.65, 0)).norm(), 1e-6);
  RoadCloud map;
  map.frame = CloudFrame::kZUp;
  map.origin = {456000.0, 5428000.0, 100.0};
  map.points = {{1, 2, 3}, {4, 5, 6}};
  PictureContent content;
  content.cloud = &map;
  EXPECT_LT((origin(content) - map.origin).norm(), 1e-6);
  // Zero has no sign.
  map.origin.setZero();
  for (const PictureContent& each : {content, scene.content()}) {
    const Eigen::Vector3d place = origin(each);
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_FALSE(place[axis] == 0.0 && std::signbit(place[axis])) << axis;
    }
  }
}

/// What the glTF 2.0 specification asks of every file, as far as ours use it: section 3.6.2 of
/// accessors, 3.6.1 of buffer views, 3.7.2 of meshes, 4.4 of chunks.
void expect_valid(const std::string& bytes) {
  const Glb glb(bytes);
  const json& d = glb.document;
  EXPECT_EQ(bytes.size() % 4, 0u);
  EXPECT_EQ(number_at(bytes, 12) % 4, 0u);
  EXPECT_EQ(glb.binary.size() % 4, 0u);
  EXPECT_EQ(d["asset"]["version"], "2.0");
  std::size_t end = 0;
  for (const json& view : d["bufferViews"]) {
    EXPECT_EQ(view["buffer"], 0);
    EXPECT_GE(view["byteOffset"].get<std::size_t>(), end) << "views overlap";
    EXPECT_GT(view["byteLength"].get<std::size_t>(), 0u);
    EXPECT_TRUE(view["target"] == 34962 || view["target"] == 34963);
    end = view["byteOffset"].get<std::size_t>() + view["byteLength"].get<std::size_t>();
    EXPECT_LE(end, glb.binary.size());
  }
  const std::map<int, std::size_t> sizes = {{5126, 4}, {5125, 4}, {5123, 2}};
  const std::map<std::string, std::size_t> lanes = {{"SCALAR", 1}, {"VEC3", 3}, {"VEC4", 4}};
  std::vector<int> used(d["accessors"].size());
  for (const json& accessor : d["accessors"]) {
    const json& view = d["bufferViews"][accessor["bufferView"].get<std::size_t>()];
    const std::size_t size = sizes.at(accessor["componentType"]) * lanes.at(accessor["type"]);
    EXPECT_GT(accessor["count"].get<std::size_t>(), 0u);
    EXPECT_EQ(size % 4 == 0 || view["target"] == 34963, true) << "vertices at multiples of four";
    EXPECT_LE(accessor["count"].get<std::size_t>() * size, view["byteLength"].get<std::size_t>());
  }
  for (const json& mesh : d["meshes"]) {
    EXPECT_FALSE(mesh["name"].get<std::string>().empty());
    ASSERT_FALSE(mesh["primitives"].empty());
    for (const json& primitive : mesh["primitives"]) {
      const std::size_t at = primitive["attributes"]["POSITION"].get<std::size_t>();
      const json& accessor = d["accessors"].at(at);
      used[at] = 1;
      // The bounds are those of the data, exactly.
      const auto points = glb.positions(primitive);
      Eigen::Vector3f low = points[0], high = points[0];
      for (const Eigen::Vector3f& p : points) {
        ASSERT_TRUE(p.allFinite());
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
      }
      for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(accessor["min"][static_cast<std::size_t>(k)].get<float>(), low[k]);
        EXPECT_EQ(accessor["max"][static_cast<std::size_t>(k)].get<float>(), high[k]);
      }
      if (primitive["attributes"].contains("COLOR_0")) {
        const std::size_t colors = primitive["attributes"]["COLOR_0"].get<std::size_t>();
        used[colors] = 1;
        EXPECT_EQ(d["accessors"].at(colors)["count"], accessor["count"]);
        EXPECT_EQ(d["accessors"].at(colors)["normalized"], true);
      }
      const int mode = primitive["mode"];
      std::size_t corners = points.size();
      if (primitive.contains("indices")) {
        const std::size_t index = primitive["indices"].get<std::size_t>();
        used[index] = 1;
        const json& indices = d["accessors"].at(index);
        const json& view = d["bufferViews"][indices["bufferView"].get<std::size_t>()];
        EXPECT_EQ(view["target"], 34963);
        corners = indices["count"];
        for (std::size_t i = 0; i < corners; ++i) {
          ASSERT_LT(number_at(glb.binary, view["byteOffset"].get<std::size_t>() + 4 * i),
                    points.size());
        }
      }
      EXPECT_EQ(corners % (mode == 4 ? 3 : mode == 1 ? 2 : 1), 0u) << mesh["name"];
      EXPECT_LT(primitive["material"].get<std::size_t>(), d["materials"].size());
    }
  }
  for (const int u : used) EXPECT_EQ(u, 1) << "an accessor that nothing uses";
  // Every node has a name and is reached once; children are nodes.
  std::vector<int> reached(d["nodes"].size());
  const std::function<void(const json&)> visit = [&](const json& list) {
    ASSERT_FALSE(list.empty());
    for (const json& index : list) {
      const json& node = d["nodes"].at(index.get<std::size_t>());
      ++reached[index.get<std::size_t>()];
      EXPECT_FALSE(node["name"].get<std::string>().empty());
      if (node.contains("mesh")) {
        EXPECT_LT(node["mesh"].get<std::size_t>(), d["meshes"].size());
      }
      if (node.contains("children")) visit(node["children"]);
    }
  };
  visit(d["scenes"][d["scene"].get<std::size_t>()]["nodes"]);
  for (const int r : reached) EXPECT_EQ(r, 1);
}

TEST(Gltf, IsValidWhateverIsThere) {
  const PictureScene scene;
  expect_valid(encode_glb(scene.content()));
  GltfOptions thin;
  thin.max_points = 7;
  expect_valid(encode_glb(scene.content(), thin));
  PictureContent content = scene.content();
  content.title = "caf\xc3\xa9 \"quoted\"";
  content.cloud = nullptr;
  expect_valid(encode_glb(content));
  content = PictureContent{};
  content.cloud = &scene.cloud;
  expect_valid(encode_glb(content));
  content = PictureContent{};
  content.surface = &scene.surface;
  expect_valid(encode_glb(content));
  content = scene.content();
  content.camera = nullptr;
  expect_valid(encode_glb(content));
  // Boundaries that are no polygons, names and places that are odd.
  PictureScene odd;
  odd.surface.patches[0].boundary.resize(2);
  odd.vehicles.frames[0].vehicles[0].vehicle_class.clear();
  odd.run.cameras.resize(1);
  expect_valid(encode_glb(odd.content()));
}

TEST(Gltf, ThinsPointsAndLeavesTruthOutWhereAsked) {
  const PictureScene scene;
  GltfOptions options;
  options.max_points = 1000;
  options.show_truth = false;
  const Glb glb(encode_glb(scene.content(), options));
  EXPECT_EQ(glb.node("truth"), nullptr);
  const json& mesh = glb.document["meshes"][(*glb.node("road points"))["mesh"].get<int>()];
  EXPECT_LE(glb.positions(mesh["primitives"][0]).size(), 1000u);
  EXPECT_GE(glb.positions(mesh["primitives"][0]).size(), 900u);
}

TEST(Gltf, UnwritableOutputAndNothingToShow) {
  const PictureScene scene;
  EXPECT_THROW(write_glb(scene.content(), "/nonexistent-folder/scene.glb"), OutputError);
  EXPECT_THROW(encode_glb(PictureContent{}), NoAnswerError);
}

TEST(Report, IsSelfContainedAndTellsTheRun) {
  PictureScene scene;
  scene.run.seed = 77;
  scene.run.timings.add("motion", 12.5);
  scene.run.extra["command"] = "camber reconstruct <scene> & more";
  scene.run.input_hashes = {{"image_00.png", "0123456789abcdef"}};
  scene.run.points_dropped = {{"behind_camera", 321}};
  for (int i = 0; i < 12; ++i) {
    const double z = 1.5 * i;
    scene.surface.driven_line.emplace_back(0.0, PictureScene::road_y(z), z);
  }
  ReportContent content;
  content.picture = scene.content();
  content.picture.title = "a <b>road</b>";
  *content.metrics = {{"scale_error", 0.0123},
                      {"by_distance", {{"to_15", {{"center_error", {{"mean", 0.987}}}}}}},
                      {"vehicles", {{{"frame", 7}, {"estimate_id", 2}, {"distance", 45.6}}}}};
  scene.run.extra["libraries"] = library_versions();
  const std::string page = make_report(content);
  EXPECT_EQ(page, make_report(content));
  EXPECT_THAT(page, HasSubstr("<h1>a &lt;b&gt;road&lt;/b&gt;</h1>"));
  EXPECT_THAT(page, HasSubstr("camber reconstruct &lt;scene&gt; &amp; more"));
  for (const char* part :
       {"0123456789abcdef", "behind_camera", "321", "12.5", "77", "scale_error", "0.0123", "0.987",
        "45.6", "<h2>Vehicles</h2>", "<h2>Patches</h2>", "Profile along the driven line",
        "<h3>Frame 7</h3>", "height, m", "grade, %", "cross slope, %", "Ceres 2.",
        "Vehicle by vehicle", "up to 15"}) {
    EXPECT_THAT(page, HasSubstr(part));
  }
  // Nothing is loaded from elsewhere.
  for (const char* outside : {"http:", "https:", "src=\"/", "href=", "@import", "url("}) {
    EXPECT_THAT(page, Not(HasSubstr(outside)));
  }
}

TEST(Report, TheViewIsOptionalAndPicturesAreEmbedded) {
  const PictureScene scene;
  const test::TemporaryFolder folder;
  ReportContent content;
  content.picture = scene.content();
  content.picture_folder = folder.path();
  ReportOptions options;
  options.embed_3d = false;
  const std::string without = make_report(content, options);
  EXPECT_THAT(without, Not(HasSubstr("<script")));
  EXPECT_THAT(without, Not(HasSubstr("<img")));
  write_png(make_picture(8, 8, 10), folder.path() / "bev.png");
  write_png(make_picture(8, 8, 10), folder.path() / "overlay_000007.png");
  const std::string with = make_report(content, options);
  EXPECT_THAT(with, HasSubstr("data:image/png;base64,iVBORw0KGgo"));  // a PNG's first bytes
  EXPECT_THAT(make_report(content), HasSubstr("<canvas id=view>"));
}

TEST(Report, PicturesOfAComparisonAreShown) {
  const PictureScene scene;
  const test::TemporaryFolder folder;
  ReportContent content;
  content.picture = scene.content();
  content.picture_folder = folder.path();
  ReportOptions options;
  options.embed_3d = false;
  int shown = 0;
  for (const char* name : {"height_error.png", "histogram.png", "cumulative.png"}) {
    write_png(make_picture(8, 8, 10), folder.path() / name);
    ++shown;
    const std::string page = make_report(content, options);
    int images = 0;
    for (auto at = page.find("<img"); at != std::string::npos; at = page.find("<img", at + 1)) {
      ++images;
    }
    EXPECT_EQ(images, shown) << name;
  }
}

TEST(Report, LongRunsFoldWhatIsNotShown) {
  PictureScene scene;
  for (int i = 0; i < 9; ++i) {
    scene.vehicles.frames.push_back(scene.vehicles.frames[0]);
    scene.vehicles.frames.back().id = 20 + i;
  }
  for (int i = 0; i < 60; ++i) {
    scene.surface.patches.push_back(scene.surface.patches[0]);
    scene.surface.patches.back().id = 1 + i;
  }
  ReportContent content;
  content.picture = scene.content();
  const std::string page = make_report(content);
  EXPECT_THAT(page, HasSubstr("<h3>Frame 7</h3>"));  // the shown one
  EXPECT_THAT(page, HasSubstr("<details><summary>Frame 28</summary>"));
  EXPECT_THAT(page, HasSubstr("<details><summary>61 patches</summary>"));
}

TEST(Report, UnwritableOutputAndBadOptions) {
  const PictureScene scene;
  ReportContent content;
  content.picture = scene.content();
  EXPECT_THROW(write_report(content, "/nonexistent-folder/report.html"), OutputError);
  ReportOptions options;
  options.max_points = 0;
  EXPECT_THROW(make_report(content, options), std::invalid_argument);
}

TEST(Report, WithoutScaleNoMetreIsClaimed) {
  PictureScene scene;
  scene.run.metric = scene.surface.metric = false;
  ReportContent content;
  content.picture = scene.content();
  const std::string page = make_report(content);
  EXPECT_THAT(page, HasSubstr("up to scale"));
  // The first paragraph names what would give metres.
  const std::string first = page.substr(page.find("<p>"), page.find("</p>") - page.find("<p>"));
  EXPECT_THAT(first, HasSubstr("Lengths are in units, not in metres"));
  EXPECT_THAT(first, HasSubstr("--height of camber import"));
  EXPECT_THAT(page, HasSubstr("bottom centre (units)"));
  EXPECT_THAT(page, Not(HasSubstr("bottom centre (m)")));
}

}  // namespace
}  // namespace camber
