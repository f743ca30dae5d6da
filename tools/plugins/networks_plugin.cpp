#include "late_networks.h"
#include "plugin.h"

CAMBER_EXPORT const camber::tools::NetworkFunctions* camber_networks();
CAMBER_EXPORT const camber::tools::NetworkFunctions* camber_networks() {
  static const camber::tools::NetworkFunctions functions = {camber::open_network};
  return &functions;
}
