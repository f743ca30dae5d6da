#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../tools/options.h"
#include "../tools/own_inputs.h"

namespace camber {

/// What `camber view` takes and hands on to camber-view.
struct ViewArguments {
  std::string input, scene, truth, color = "height", snapshots = "camber-view", picture;
  std::optional<int> frame;
  std::vector<double> up, bounds;
  bool json = false, confine = false;

  void add_to(tools::App& app) {
    app.add_option("input", input, "result folder, or a cloud of any format")->required();
    app.add_option("--scene", scene,
                   "manifest of the run: adds images, the camera and the truth; default: the one "
                   "that the run read, if it is still there");
    tools::add_confine_option(app, confine);
    app.add_option("--truth", truth,
                   "dense ground truth: a cloud in the input's frame, or the word scene for that "
                   "of the scene");
    app.add_option("--frame", frame, "frame id to begin with; default: the reference");
    app.add_option("--color", color,
                   "of the points: height, sigma, patch, image, error, or the name of an attribute")
        ->no_name()
        ->capture_default_str();
    app.add_option("--up", up, "x,y,z: up in the input's frame")->delimiter(',')->expected(3);
    app.add_option("--bounds", bounds,
                   "x0,y0,x1,y1: what lies within, in the input's coordinates and units; of the "
                   "joined patches of camber tiles those that reach into it, without the rest")
        ->check(tools::finite_number())
        ->delimiter(',')
        ->expected(4);
    app.add_option("--snapshots", snapshots, "the key s writes NAME-1.png, NAME-2.png, ...")
        ->no_name()
        ->capture_default_str();
    app.add_option(
           "--picture", picture,
           "write a picture of the window, as it is at the beginning, into this PNG and end")
        ->output_file();
    app.add_flag("--json", json,
                 "print what was shown and written as JSON to stdout once the window is closed");
  }

  /// The arguments that give the same view again.
  std::vector<std::string> words() const {
    std::vector<std::string> out = {input, "--color", color, "--snapshots", snapshots};
    const auto add = [&](const char* option, const std::string& value) {
      if (!value.empty()) out.insert(out.end(), {option, value});
    };
    add("--scene", scene);
    add("--truth", truth);
    add("--picture", picture);
    if (json) out.emplace_back("--json");
    if (confine) out.emplace_back("--confine");
    if (frame) add("--frame", std::to_string(*frame));
    if (bounds.size() == 4) {
      out.push_back("--bounds=" + tools::to_text(bounds[0]) + "," + tools::to_text(bounds[1]) +
                    "," + tools::to_text(bounds[2]) + "," + tools::to_text(bounds[3]));
    }
    if (up.size() == 3) {
      out.push_back("--up=" + tools::to_text(up[0]) + "," + tools::to_text(up[1]) + "," +
                    tools::to_text(up[2]));
    }
    return out;
  }
};

}  // namespace camber
