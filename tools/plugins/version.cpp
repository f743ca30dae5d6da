#include "camber/core/version.h"

#include "plugin.h"

CAMBER_EXPORT const char* camber_plugin_version();
CAMBER_EXPORT const char* camber_plugin_version() { return camber::kVersion; }
