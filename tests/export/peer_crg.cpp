#include "peer_crg.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>

#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber::test {

#ifdef CAMBER_CRG_HEIGHTS
bool has_crg_peer() { return true; }
fs::path crg_samples() { return CAMBER_CRG_SAMPLES; }
constexpr const char* kProgram = CAMBER_CRG_HEIGHTS;
#else
bool has_crg_peer() { return false; }
fs::path crg_samples() { return {}; }
constexpr const char* kProgram = "";
#endif

std::vector<double> crg_peer_heights(const fs::path& file, const std::vector<CrgPlace>& places,
                                     bool apply) {
  const TemporaryFolder folder;
  const fs::path in = folder.path() / "in", out = folder.path() / "out";
  {
    std::FILE* const list = std::fopen(in.c_str(), "w");
    for (const CrgPlace& place : places) {
      std::fprintf(list, "%s %.17g %.17g\n", place.by_xy ? "xy" : "uv", place.a, place.b);
    }
    std::fclose(list);
  }
  const std::string command = "cd '" + file.parent_path().string() + "' && '" + kProgram + "' '" +
                              file.filename().string() + "'" + (apply ? " apply" : "") + " < '" +
                              in.string() + "' > '" + out.string() + "' 2> /dev/null";
  if (std::system(command.c_str()) != 0) return {};
  std::vector<double> heights;
  std::ifstream answers(out);
  std::string word;
  while (answers >> word) {
    heights.push_back(word == "none" ? std::numeric_limits<double>::quiet_NaN()
                                     : std::strtod(word.c_str(), nullptr));
  }
  return heights;
}

}  // namespace camber::test
