#pragma once

#include "camber/detect/network.h"

namespace camber::tools {

/// What the plugin networks exports as camber_networks(): the functions of the library that call
/// OpenCV's DNN.
struct NetworkFunctions {
  decltype(&camber::open_network) open_network;
};

}  // namespace camber::tools
