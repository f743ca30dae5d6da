#include "plugin.h"

#include <dlfcn.h>
#include <unistd.h>

#include <climits>
#include <string>

#include "camber/core/errors.h"
#include "camber/core/version.h"

namespace camber::tools {
namespace {

/// The folder of the plugins, next to the one of the program.
std::string plugin_folder() {
  char self[PATH_MAX];
  const ssize_t length = ::readlink("/proc/self/exe", self, sizeof self);
  const std::string program(self, length > 0 ? static_cast<std::size_t>(length) : 0);
  return program.substr(0, program.rfind('/') + 1) + CAMBER_PLUGIN_FOLDER;
}

std::string plugin_file(const std::string& plugin) {
  return plugin_folder() + "/libcamber_" + plugin + ".so";
}

/// Whether the dynamic loader failed for want of memory. Without memory for the name of a file that
/// is there it reports that there is none.
bool names_memory(const std::string& file, const std::string& reason) {
  if (reason.rfind(file + ": cannot open shared object file: No such file", 0) == 0 &&
      ::access(file.c_str(), F_OK) == 0) {
    return true;
  }
  for (const char* part : {"failed to map", "cannot allocate memory", "Cannot allocate memory",
                           "cannot apply additional memory", "cannot create shared object"}) {
    if (reason.find(part) != std::string::npos) return true;
  }
  return false;
}

[[noreturn]] void refuse(const std::string& file, const std::string& reason) {
  if (names_memory(file, reason)) {
    throw MachineError("out of memory: " + file + " cannot be loaded: " + reason);
  }
  throw MachineError("this part of the program cannot be loaded: " + file + ": " + reason +
                     "; build or install the program anew");
}

}  // namespace

bool has_plugin(const std::string& plugin) {
  return ::access(plugin_file(plugin).c_str(), F_OK) == 0;
}

void* plugin_symbol(const std::string& plugin, const char* symbol) {
  const std::string file = plugin_file(plugin);
  if (::access(file.c_str(), F_OK) != 0) refuse(file, "no such file");
  void* module = ::dlopen(file.c_str(), RTLD_LAZY | RTLD_LOCAL);
  if (!module) refuse(file, ::dlerror());
  using Version = const char* (*)();
  const auto version = reinterpret_cast<Version>(::dlsym(module, "camber_plugin_version"));
  const std::string made_for = version ? version() : "none";
  if (made_for != kVersion) refuse(file, "found version " + made_for + ", expected " + kVersion);
  void* found = ::dlsym(module, symbol);
  if (!found) refuse(file, std::string("found no ") + symbol);
  return found;
}

}  // namespace camber::tools
