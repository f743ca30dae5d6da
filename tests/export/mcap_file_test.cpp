#include "camber/export/mcap_file.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/import/recording.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;

/// Two topics in several chunks; the time of message i is 1e18 + i seconds.
std::string make_file(std::size_t chunk_size) {
  std::ostringstream out;
  McapWriter writer(out, chunk_size);
  const std::uint16_t image =
      writer.add_schema("foxglove.CompressedImage", foxglove_schema("foxglove.CompressedImage"));
  const std::uint16_t camera = writer.add_channel(image, "/camera");
  for (std::uint64_t i = 0; i < 50; ++i) {
    writer.write(camera, 1000000000000000000u + i, json{{"number", i}}.dump());
    if (i != 20) continue;
    // A topic that comes later.
    const std::uint16_t fix =
        writer.add_schema("foxglove.LocationFix", foxglove_schema("foxglove.LocationFix"));
    writer.write(writer.add_channel(fix, "/fix"), 5, "{}");
  }
  writer.finish();
  return out.str();
}

TEST(McapFile, HoldsItsMessages) {
  for (const std::size_t chunk_size : {std::size_t{1}, std::size_t{300}, std::size_t{1} << 20}) {
    const std::string bytes = make_file(chunk_size);
    const auto bag = open_mcap(bytes.data(), bytes.size(), "a.mcap");
    ASSERT_EQ(bag->topics().size(), 2u);
    EXPECT_EQ(bag->topics()[0].name, "/camera");
    EXPECT_EQ(bag->topics()[0].type, "foxglove.CompressedImage");
    EXPECT_EQ(bag->topics()[0].messages, 50u);
    EXPECT_EQ(bag->topics()[1].messages, 1u);
    std::uint64_t i = 0;
    bag->read("/camera", [&](const BagMessage& message) {
      const std::string text(reinterpret_cast<const char*>(message.data), message.size);
      EXPECT_EQ(json::parse(text).at("number"), i);
      EXPECT_EQ(message.recorded_ns, static_cast<std::int64_t>(1000000000000000000u + i));
      ++i;
      return true;
    });
    EXPECT_EQ(i, 50u);
  }
}

TEST(McapFile, IsReadByItsIndexByMcapCore) {
  if (std::system("command -v node >/dev/null 2>&1 && node -e \"require('@mcap/core');"
                  "require('fzstd')\" >/dev/null 2>&1") != 0) {
    GTEST_SKIP() << "no node with the npm packages @mcap/core and fzstd (set NODE_PATH)";
  }
  const test::TemporaryFolder folder;
  const std::string file = folder.path() / "a.mcap", out = folder.path() / "out.json";
  std::ofstream(file, std::ios::binary) << make_file(300);
  std::ofstream(folder.path() / "read.js") << R"(
    const fs = require('fs'), {McapIndexedReader} = require('@mcap/core'), fzstd = require('fzstd');
    const bytes = fs.readFileSync(process.argv[2]);
    const source = {size: async () => BigInt(bytes.length),
                    read: async (at, size) => bytes.subarray(Number(at), Number(at + size))};
    (async () => {
      const reader = await McapIndexedReader.Initialize({
        readable: source, decompressHandlers: {zstd: (data) => fzstd.decompress(data)}});
      const counts = {}, numbers = [];
      for await (const message of reader.readMessages()) {
        const topic = reader.channelsById.get(message.channelId).topic;
        counts[topic] = (counts[topic] || 0) + 1;
        const parsed = JSON.parse(Buffer.from(message.data).toString());
        if (topic === '/camera') numbers.push(parsed.number);
      }
      const schemas = [...reader.schemasById.values()].map((s) => s.name).sort();
      fs.writeFileSync(process.argv[3], JSON.stringify({
        counts, numbers, schemas, stated: Number(reader.statistics.messageCount)}));
    })();
  )";
  const std::string command =
      "node '" + (folder.path() / "read.js").string() + "' '" + file + "' '" + out + "'";
  ASSERT_EQ(std::system(command.c_str()), 0);
  const json found = json::parse(test::read_text(out));
  EXPECT_EQ(found.at("counts").at("/camera"), 50);
  EXPECT_EQ(found.at("counts").at("/fix"), 1);
  EXPECT_EQ(found.at("stated"), 51);
  EXPECT_EQ(found.at("schemas"), json({"foxglove.CompressedImage", "foxglove.LocationFix"}));
  for (int i = 0; i < 50; ++i) EXPECT_EQ(found.at("numbers")[static_cast<std::size_t>(i)], i);
}

TEST(Foxglove, SchemasAndBase64) {
  for (const char* const name :
       {"foxglove.CompressedImage", "foxglove.CameraCalibration", "foxglove.FrameTransform",
        "foxglove.PointCloud", "foxglove.SceneUpdate", "foxglove.LocationFix"}) {
    const json schema = json::parse(foxglove_schema(name));
    EXPECT_EQ(schema.at("title"), name);
    EXPECT_EQ(schema.at("type"), "object");
    EXPECT_FALSE(schema.at("properties").empty());
  }
  EXPECT_THROW(foxglove_schema("foxglove.Grid"), std::invalid_argument);
  // RFC 4648, section 10.
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64("\xff\xfe"), "//4=");
}

}  // namespace
}  // namespace camber
