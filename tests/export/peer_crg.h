#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace camber::test {

/// A place that a peer is asked about: u and v, or x and y.
struct CrgPlace {
  bool by_xy = false;
  double a = 0.0, b = 0.0;
};

/// Whether ASAM's reader was there when the tests were built.
bool has_crg_peer();
std::filesystem::path crg_samples();

/// Heights as ASAM's reader gives them, in its own process (it keeps settings from file to file),
/// run in the folder of the file; NaN where it answers none. Empty where it does not take the file.
std::vector<double> crg_peer_heights(const std::filesystem::path& file,
                                     const std::vector<CrgPlace>& places, bool apply);

}  // namespace camber::test

#define CAMBER_REQUIRE_CRG_PEER()                                                          \
  do {                                                                                     \
    if (!camber::test::has_crg_peer()) {                                                   \
      GTEST_SKIP() << "no ../shared/peers (set CAMBER_PEERS and configure again): ASAM's " \
                      "OpenCRG reader";                                                    \
    }                                                                                      \
  } while (false)
