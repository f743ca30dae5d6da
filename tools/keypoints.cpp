// camber keypoints: the keypoint network's training data.

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/image/image_io.h"
#include "camber/synth/keypoint_crops.h"
#include "command.h"
#include "keypoint_network.h"

namespace camber::tools {
namespace {

struct SynthesiseArguments {
  KeypointCropOptions options;
  std::string out, sheet, split = "training";
  int count = 1000, first = 0;
  bool overwrite = false, json = false;
};

void write_sheet(const SynthesiseArguments& args, const KeypointCropOptions& options) {
  constexpr int kMost = 1200;  // more is no picture
  if (options.count > kMost) {
    throw UsageError("--count: found " + std::to_string(options.count) +
                     ", a --sheet has at most " + std::to_string(kMost));
  }
  check_output_file(args.sheet);
  require_png("--sheet", args.sheet);
  const auto crops = KeypointCropMaker(options).make(options.first, options.count);
  write_png(draw_crop_sheet(crops, 6, std::max(1, 160 / options.size)), args.sheet);
}

int synthesise(const Command& command, const SynthesiseArguments& args) {
  KeypointCropOptions options = args.options;
  options.count = args.count;
  options.first = args.first;
  options.seed = command.common.seed;
  options.num_threads = command.common.threads;
  options.split = args.split == "training" ? CropSplit::kTraining : CropSplit::kValidation;
  if (args.out.empty() == args.sheet.empty()) {
    throw UsageError("keypoints synthesise: expected either --out or --sheet");
  }
  if (!args.sheet.empty()) {
    write_sheet(args, options);
    return 0;
  }
  const KeypointCropSummary summary =
      write_keypoint_crops(options, args.out, args.overwrite, command.common.command_line,
                           make_progress(command.common));
  nlohmann::json timings = nlohmann::json::object();
  double seconds = 0.0;
  for (const auto& [stage, ms] : summary.timings.stages()) {
    timings[stage] = ms;
    seconds += 1e-3 * ms;
  }
  if (args.json) {
    const nlohmann::json json = {{"version", kVersion},
                                 {"seed", options.seed},
                                 {"options",
                                  {{"split", args.split},
                                   {"first", options.first},
                                   {"count", options.count},
                                   {"size", options.size},
                                   {"end_on", options.end_on}}},
                                 {"crops", summary.crops},
                                 {"cars", summary.cars},
                                 {"keypoints_by_visibility",
                                  {{"visible", summary.keypoints[0]},
                                   {"hidden_by_car", summary.keypoints[1]},
                                   {"hidden_by_other", summary.keypoints[2]},
                                   {"outside", summary.keypoints[3]}}},
                                 {"timings_ms", timings}};
    std::cout << json.dump(2) << '\n';
  } else if (!command.common.quiet) {
    std::fprintf(stderr, "%s: %lld crops of %lld cars, %.0f crops a second\n", args.out.c_str(),
                 static_cast<long long>(summary.crops), static_cast<long long>(summary.cars),
                 static_cast<double>(summary.crops) / seconds);
  }
  return 0;
}

}  // namespace

void register_keypoints(App& root) {
  App* keypoints =
      root.add_subcommand("keypoints", "The keypoint network: crops to train it, its errors");
  keypoints->require_subcommand();
  add_keypoint_network_commands(*keypoints);

  Command* command = add_command(
      *keypoints, "synthesise",
      "Makes crops of cars with their 36 keypoints: rendered cars of a wide parametric family in "
      "front of made backgrounds, as a detector's boxes cut them out of images.",
      "  camber keypoints synthesise --count 20000 --seed 1 --out training\n"
      "  camber keypoints synthesise --count 5000 --seed 1 --split validation --out validation\n"
      "  camber keypoints synthesise --count 60 --sheet sheet.png");
  const auto a = std::make_shared<SynthesiseArguments>();
  App& app = *command->app;
  app.add_option("--out", a->out, "folder of the crops (arrays, docs/formats.md)")->output_folder();
  app.add_option("--count", a->count, "number of crops")
      ->check(in_range(1, 10000000))
      ->capture_default_str();
  app.add_option("--first", a->first, "number of the first crop: a long set can be made in pieces")
      ->check(in_range(0, 1000000000))
      ->capture_default_str();
  app.add_option("--split", a->split,
                 "training or validation, which share no car and no background")
      ->check(is_member({"training", "validation"}))
      ->capture_default_str();
  app.add_option("--size", a->options.size, "side of a crop, px")
      ->check(in_range(16, 256))
      ->capture_default_str();
  app.add_option("--end-on", a->options.end_on,
                 "share of the crops that are views of a car's front or rear, as a camera on the "
                 "same road has them; the others are as without it")
      ->check(in_range(0.0, 1.0))
      ->capture_default_str();
  app.add_option("--sheet", a->sheet,
                 "FILE.png: in place of --out a picture of the crops, each also with its keypoints "
                 "(left red, right green, "
                 "hidden ones as rings) and boxes (as detected white, whole car yellow)")
      ->output_file();
  app.add_flag("--overwrite", a->overwrite, "replace a foreign folder that is not empty");
  app.add_flag("--json", a->json, "print what was made as JSON");
  command->run = [command, a] { return synthesise(*command, *a); };
}

}  // namespace camber::tools
