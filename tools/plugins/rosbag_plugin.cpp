#include "bag_reader.h"
#include "plugin.h"

CAMBER_EXPORT const camber::tools::BagFunctions* camber_rosbag();
CAMBER_EXPORT const camber::tools::BagFunctions* camber_rosbag() {
  static const camber::tools::BagFunctions functions = {camber::tools::open_bag};
  return &functions;
}
