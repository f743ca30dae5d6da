// The functions of the library that call OpenCV's DNN, as the other plugins have them: see
// late_vtk.cpp.

#include "late_networks.h"

#include <utility>

#include "plugin.h"

namespace camber {

std::unique_ptr<Network> open_network(OnnxFile file, const NetworkInput& input,
                                      const NetworkCheck& check) {
  using Functions = const tools::NetworkFunctions* (*)();
  static const auto* functions =
      reinterpret_cast<Functions>(tools::plugin_symbol("networks", "camber_networks"))();
  return functions->open_network(std::move(file), input, check);
}

}  // namespace camber
