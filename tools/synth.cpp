// camber synth: a scene of a drive with complete truth.

#include <fmt/format.h>

#include <charconv>
#include <cstdio>
#include <functional>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/import/formats/trajectory.h"
#include "camber/import/import_synthia.h"
#include "camber/synth/random_scene.h"
#include "camber/synth/synthesise.h"
#include "camber/synth/synthesise_drive.h"
#include "command.h"

namespace camber::tools {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

/// Options of the command line, set over those of a random scene or the defaults in the order in
/// which they were declared.
class Settings {
 public:
  /// An option whose value, if it is given, `apply` writes.
  template <typename Value>
  Option* add(App& app, const std::string& name, const std::string& help,
              const Value& default_value, std::function<void(const Value&, SynthOptions*)> apply) {
    const auto value = std::make_shared<Value>(default_value);
    given_.push_back({&app, name, [value, apply](SynthOptions* o) { apply(*value, o); }});
    return app.add_option(name, *value, help)->default_varies();
  }
  Option* add_flag(App& app, const std::string& name, const std::string& help,
                   std::function<void(SynthOptions*)> apply) {
    const auto value = std::make_shared<bool>(false);
    given_.push_back({&app, name, [value, apply](SynthOptions* o) { apply(o); }});
    return app.add_flag(name, *value, help)->default_varies();
  }
  /// Directly bound to a field, with its default shown.
  template <typename Value>
  Option* bind(App& app, const std::string& name, Value SynthOptions::*field,
               const std::string& help) {
    return add<Value>(app, name, help, SynthOptions().*field,
                      [field](const Value& value, SynthOptions* o) { o->*field = value; })
        ->capture_default_str();
  }
  template <typename Value>
  Option* bind_sensor(App& app, const std::string& name, Value CameraSensor::*field,
                      const std::string& help) {
    return add<Value>(app, name, help, CameraSensor().*field,
                      [field](const Value& value, SynthOptions* o) { o->sensor.*field = value; })
        ->capture_default_str();
  }
  /// A word of an enumeration.
  template <typename Kind>
  Option* add_kind(App& app, const std::string& name, const std::string& help,
                   const std::vector<Kind>& kinds, Kind (*parse)(std::string_view),
                   std::function<void(Kind, SynthOptions*)> apply) {
    std::vector<std::string> words;
    for (const Kind kind : kinds) words.emplace_back(to_string(kind));
    return add<std::string>(
               app, name, help, "",
               [parse, apply](const std::string& word, SynthOptions* o) { apply(parse(word), o); })
        ->check(is_member(words));
  }

  void apply(SynthOptions* options) const {
    for (const auto& [app, name, apply] : given_) {
      if (app->count(name) > 0) apply(options);
    }
  }

 private:
  struct Setting {
    const App* app = nullptr;
    std::string name;
    std::function<void(SynthOptions*)> apply;
  };
  std::vector<Setting> given_;
};

TurnDirection turn_from_word(const std::string& word) {
  return word == "left" ? TurnDirection::kLeft : TurnDirection::kRight;
}

void add_drive(App& app, Settings* settings) {
  settings->add_kind<RoadProfileKind>(
      app, "--profile", "shape of the road (default steep_hill)", all_road_profile_kinds(),
      road_profile_kind_from_string,
      [](RoadProfileKind kind, SynthOptions* o) { o->profile = kind; });
  settings
      ->bind(app, "--name", &SynthOptions::name,
             "name of the scene; default: profile and seed, or random_NUMBER")
      ->no_name();
  settings->bind(app, "--frames", &SynthOptions::num_frames, "number of frames");
  settings->bind(app, "--hz", &SynthOptions::frame_rate, "frames a second");
  settings->bind(app, "--speed", &SynthOptions::speed,
                 "of the camera's car, m/s; at a corner its radius and yaw rate give it");
  settings->bind(app, "--cars", &SynthOptions::num_cars, "number of cars, at most");
  settings->bind(app, "--nearest", &SynthOptions::nearest_car, "nearest car ahead, m");
  settings->bind(app, "--farthest", &SynthOptions::farthest_car, "farthest car ahead, m");
  settings->bind(app, "--cloud-points", &SynthOptions::cloud_points,
                 "points of the true road cloud");
}

void set_lens(const std::string& text, SynthOptions* options) {
  std::vector<std::string> words;
  std::istringstream in(text);
  for (std::string word; std::getline(in, word, ',');) words.push_back(word);
  if (words.empty() || (words[0] != "brown" && words[0] != "fisheye")) {
    throw UsageError("--distortion: found " + text +
                     ", expected brown or fisheye and its coefficients: MODEL,k1,k2,...");
  }
  options->lens = words[0] == "brown" ? LensModel::kBrown : LensModel::kFisheye;
  options->lens_coefficients.clear();
  for (std::size_t i = 1; i < words.size(); ++i) {
    double value = 0.0;
    const char* end = words[i].data() + words[i].size();
    const auto [at, error] = std::from_chars(words[i].data(), end, value);
    if (error != std::errc() || at != end) {
      throw UsageError("--distortion: found " + words[i] + ", expected a number");
    }
    options->lens_coefficients.push_back(value);
  }
}

void add_camera(App& app, Settings* settings) {
  settings->bind(app, "--camera-height", &SynthOptions::camera_height, "above the road, m");
  settings
      ->add<std::vector<int>>(app, "--size",
                              "width and height of the images, px (default 1242x375)", {},
                              [](const std::vector<int>& size, SynthOptions* o) {
                                const double scale = static_cast<double>(size[0]) / o->camera.width;
                                o->camera.width = size[0];
                                o->camera.height = size[1];
                                o->camera.fx *= scale;
                                o->camera.fy *= scale;
                                o->camera.cx = scale * (o->camera.cx + 0.5) - 0.5;
                                o->camera.cy = 0.46 * o->camera.height;
                              })
      ->delimiter('x')
      ->expected(2);
  settings
      ->add<std::vector<double>>(
          app, "--intrinsics", "fx,fy,cx,cy, px (default: KITTI's, scaled to the size's width)", {},
          [](const std::vector<double>& k, SynthOptions* o) {
            o->camera.fx = k[0];
            o->camera.fy = k[1];
            o->camera.cx = k[2];
            o->camera.cy = k[3];
          })
      ->delimiter(',')
      ->expected(4);
  settings
      ->add<std::string>(app, "--distortion",
                         "MODEL,COEFFICIENTS of the lens: brown,k1,k2,p1,p2[,k3[,k4,k5,k6]] or "
                         "fisheye,k1,k2,k3,k4; "
                         "size and intrinsics are then those of the image files",
                         "", set_lens)
      ->no_name();
  const auto angle = [&](const char* name, const char* help,
                         std::optional<double> MountingOptions::*field) {
    settings->add<double>(app, name, help, 0.0, [field](const double& degrees, SynthOptions* o) {
      o->features.mounting.*field = kDegree * degrees;
    });
  };
  angle("--pitch-deg", "of the camera's mounting, positive: up; else within a degree",
        &MountingOptions::pitch);
  angle("--yaw-deg", "of the mounting, positive: right", &MountingOptions::yaw);
  angle("--roll-deg", "of the mounting, positive: its right side is low", &MountingOptions::roll);
  settings
      ->add<double>(
          app, "--ahead-of-axle", "camera before the rear axle, m", MountingOptions().ahead_of_axle,
          [](const double& value, SynthOptions* o) { o->features.mounting.ahead_of_axle = value; })
      ->capture_default_str();
  settings->bind_sensor(app, "--supersampling", &CameraSensor::supersampling,
                        "samples a pixel and direction");
  settings->bind_sensor(app, "--noise", &CameraSensor::noise, "of the images, grey levels");
  settings->bind_sensor(app, "--blur", &CameraSensor::blur, "of the lens, px");
  settings->bind_sensor(app, "--exposure-change", &CameraSensor::exposure_change,
                        "relative, from frame to frame");
  settings->bind_sensor(app, "--vignetting", &CameraSensor::vignetting,
                        "relative loss of light at the corners");
}

void add_layout(App& app, Settings* settings) {
  settings->add_kind<SceneLayout>(
      app, "--layout", "files as Camber or as a data set has them (default camber)",
      all_scene_layouts(), scene_layout_from_string,
      [](SceneLayout layout, SynthOptions* o) { o->layout.layout = layout; });
  settings->add<int>(app, "--sequence",
                     "number of the data set's sequence (default 0; SYNTHIA-SF 1)", 0,
                     [](const int& number, SynthOptions* o) { o->layout.sequence = number; });
  settings->add_flag(app, "--classes-only", "GTLeft of SYNTHIA-SF without numbers of vehicles",
                     [](SynthOptions* o) { o->layout.instance_ids = false; });
}

/// The camera of SYNTHIA-SF, whose sequences count from 1.
void follow_layout(const App& app, SynthOptions* options) {
  if (options->layout.layout != SceneLayout::kSynthiaSf) return;
  if (app.count("--sequence") == 0) options->layout.sequence = 1;
  if (app.count("--intrinsics") > 0) return;
  const bool sized = app.count("--size") > 0;
  options->camera = synthia_sf_camera(sized ? options->camera.width : 1920,
                                      sized ? options->camera.height : 1080);
}

/// A number of a feature; the default is that of its struct.
template <typename Part>
void add_number(App& app, Settings* settings, const std::string& name, const std::string& help,
                Part SceneFeatures::*part, double Part::*field, double unit = 1.0) {
  settings
      ->add<double>(app, name, help, (SceneFeatures().*part).*field / unit,
                    [part, field, unit](const double& value, SynthOptions* o) {
                      (o->features.*part).*field = unit * value;
                    })
      ->capture_default_str();
}

/// A number of a feature that is drawn where it is not given.
template <typename Part>
void add_drawn(App& app, Settings* settings, const std::string& name, const std::string& help,
               Part SceneFeatures::*part, std::optional<double> Part::*field, double unit = 1.0) {
  settings->add<double>(app, name, help, 0.0,
                        [part, field, unit](const double& value, SynthOptions* o) {
                          (o->features.*part).*field = unit * value;
                        });
}

void add_turning(App& app, Settings* settings) {
  settings->add_kind<CornerKind>(app, "--corner", "turn at a corner of streets", all_corner_kinds(),
                                 corner_kind_from_string, [](CornerKind kind, SynthOptions* o) {
                                   o->features.corner.enabled = true;
                                   o->features.corner.kind = kind;
                                 });
  add_number(app, settings, "--corner-radius", "of the rear axle's path, m", &SceneFeatures::corner,
             &CornerOptions::radius);
  add_number(app, settings, "--corner-yaw-rate-deg", "degrees a second", &SceneFeatures::corner,
             &CornerOptions::yaw_rate, kDegree);
  add_number(app, settings, "--corner-phase", "share of the turn done in the middle of the drive",
             &SceneFeatures::corner, &CornerOptions::phase);
  add_number(app, settings, "--corner-angle-deg", "between the streets", &SceneFeatures::corner,
             &CornerOptions::angle, kDegree);
  add_number(app, settings, "--corner-grade",
             "of the other street away from the road, rise a metre", &SceneFeatures::corner,
             &CornerOptions::arm_grade);
  add_number(app, settings, "--bend-radius", "of the road under the camera, m; 0: its own shape",
             &SceneFeatures::bend, &BendOptions::radius);
  settings
      ->add<std::string>(app, "--turn", "direction of a corner or bend (default right)", "",
                         [](const std::string& word, SynthOptions* o) {
                           o->features.corner.turn = turn_from_word(word);
                           o->features.bend.turn = turn_from_word(word);
                         })
      ->check(is_member({"left", "right"}));
  settings->add<double>(app, "--lead-car", "gap to a car ahead that keeps its distance, m", 0.0,
                        [](const double& gap, SynthOptions* o) {
                          o->features.lead_car = {true, gap};
                        });
}

void add_surroundings(App& app, Settings* settings) {
  settings->add_kind<AsphaltTexture>(
      app, "--asphalt", "texture of the carriageway (default varied)", all_asphalt_textures(),
      asphalt_texture_from_string,
      [](AsphaltTexture texture, SynthOptions* o) { o->features.asphalt.texture = texture; });
  add_drawn(app, settings, "--asphalt-contrast", "of the texture; else 0.6 to 1.1",
            &SceneFeatures::asphalt, &AsphaltOptions::contrast);
  add_number(app, settings, "--wet", "water on the asphalt, 0 to 1", &SceneFeatures::asphalt,
             &AsphaltOptions::wetness);
  settings->add_kind<Pavements>(
      app, "--pavements", "where there are pavements", all_pavements(), pavements_from_string,
      [](Pavements which, SynthOptions* o) { o->features.roadside.pavements = which; });
  add_drawn(app, settings, "--kerb-height", "m (default 0.15)", &SceneFeatures::roadside,
            &RoadsideOptions::kerb_height);
  add_drawn(app, settings, "--edge-distance", "from the camera to the carriageway's right edge, m",
            &SceneFeatures::roadside, &RoadsideOptions::edge_distance);
  add_drawn(app, settings, "--half-width", "of the carriageway, m; else 3.3 to 3.9",
            &SceneFeatures::roadside, &RoadsideOptions::half_width);
  add_number(app, settings, "--verge-rise", "of verges above the road's edge, m",
             &SceneFeatures::roadside, &RoadsideOptions::verge_rise);
  settings->add_kind<Markings>(
      app, "--markings", "on the carriageway", all_markings(), markings_from_string,
      [](Markings which, SynthOptions* o) { o->features.markings = which; });
  add_drawn(app, settings, "--cloudiness", "0 clear to 1 overcast", &SceneFeatures::weather,
            &WeatherOptions::cloudiness);
  add_drawn(app, settings, "--sun-elevation-deg", "height of the sun; else 35 to 60",
            &SceneFeatures::weather, &WeatherOptions::sun_elevation, kDegree);
  add_number(app, settings, "--haze-distance", "at which 63 % is haze, m", &SceneFeatures::weather,
             &WeatherOptions::haze_distance);
  settings->add_flag(app, "--lights", "the lights of cars that drive are on",
                     [](SynthOptions* o) { o->features.weather.lights_on = true; });
}

/// @throws UsageError for an option of what the scene does not have, which would change nothing.
void check_used(const App& app, const SynthOptions& options) {
  const auto expect = [&](bool used, const char* option, const char* of) {
    if (app.count(option) > 0 && !used) {
      throw UsageError(fmt::format("{}: expected {} beside it", option, of));
    }
  };
  const bool corner = options.features.corner.enabled;
  for (const char* option : {"--corner-radius", "--corner-yaw-rate-deg", "--corner-phase",
                             "--corner-angle-deg", "--corner-grade"}) {
    expect(corner, option, "--corner");
  }
  expect(corner || options.features.bend.radius > 0.0, "--turn", "--corner or --bend-radius");
  expect(options.layout.layout != SceneLayout::kCamber, "--sequence", "--layout of a data set");
  expect(options.layout.layout == SceneLayout::kSynthiaSf, "--classes-only", "--layout synthia-sf");
}

nlohmann::json timings_json(const SynthSummary& summary) {
  nlohmann::json timings = nlohmann::json::object();
  for (const auto& [stage, ms] : summary.timings.stages()) timings[stage] = ms;
  return timings;
}

nlohmann::json summary_json(const SynthOptions& options, const SynthSummary& summary,
                            const std::string& folder) {
  return {{"version", kVersion},
          {"seed", options.seed},
          {"options", options_json(options)},
          {"scene", folder},
          {"name", summary.name},
          {"frames", options.num_frames},
          {"cars", summary.cars},
          {"detections", summary.detections},
          {"speed", summary.speed},
          {"timings_ms", timings_json(summary)}};
}

/// Options of whole drives.
struct DriveArguments {
  bool drive = false;
  std::string path;
  int standstills = 0;
  SynthDriveOptions options;  ///< those of its own
};

void add_whole_drives(App& app, DriveArguments* a) {
  app.add_flag("--drive", a->drive,
               "a whole drive: a road drawn at random with hills, bends, corners and banks, "
               "traffic, standstills (default 150 frames)");
  app.add_option("--path", a->path,
                 "of --drive: file of a camera pose a frame (KITTI, TUM) that it follows");
  app.add_option("--standstills", a->standstills,
                 "of --drive: how often the car stands; else drawn, about once in 300 frames")
      ->check(whole_number());
  app.add_option("--traffic", a->options.traffic, "of --drive: density of cars")
      ->capture_default_str()
      ->default_varies();
  app.add_option("--height-sigma", a->options.height_sigma,
                 "of --drive: stated of the camera height, m; the true one is a draw")
      ->capture_default_str()
      ->default_varies();
  app.add_option("--focal-sigma", a->options.focal_sigma,
                 "of --drive, relative: of half of the seeds the true focal length is a draw")
      ->capture_default_str()
      ->default_varies();
  app.add_option("--cloud-density", a->options.cloud_density,
                 "of --drive: points of the true road cloud a metre of road")
      ->capture_default_str()
      ->default_varies();
}

/// @throws UsageError for options of the other kind of scene.
void check_drive_used(const App& app, bool drive) {
  const auto refuse = [&](std::initializer_list<const char*> options, const char* expected) {
    for (const char* option : options) {
      if (app.count(option) > 0) {
        throw UsageError(fmt::format("{}: expected {}", option, expected));
      }
    }
  };
  if (drive) {
    refuse({"--profile", "--cars", "--nearest", "--farthest", "--cloud-points", "--corner",
            "--bend-radius", "--turn", "--lead-car", "--layout", "--distortion"},
           "a scene without --drive, which draws its own road and traffic");
    if (app.count("--path") > 0) refuse({"--standstills", "--speed"}, "none beside --path");
  } else {
    refuse({"--path", "--standstills", "--traffic", "--height-sigma", "--focal-sigma",
            "--cloud-density"},
           "--drive beside it");
  }
}

/// What a drive makes of a scene's options.
SynthDriveOptions drive_options(const App& app, const DriveArguments& a, SynthOptions scene) {
  SynthDriveOptions out = a.options;
  if (app.count("--random") > 0) {
    scene.features.corner = {};
    scene.features.bend = {};
    scene.features.lead_car = {};
    if (app.count("--name") == 0) scene.name.replace(0, 6, "drive");  // "random_00017"
    if (app.count("--speed") == 0) scene.speed = std::max(3.0, scene.speed);
  } else {
    if (app.count("--ahead-of-axle") == 0) scene.features.mounting.ahead_of_axle = 1.5;
    if (app.count("--supersampling") == 0) scene.sensor.supersampling = 2;
  }
  if (app.count("--frames") == 0) scene.num_frames = 150;
  if (app.count("--standstills") > 0) out.standstills = a.standstills;
  if (!a.path.empty()) {
    out.path.emplace();
    for (const TimedPose& pose : read_poses(a.path).poses) {
      out.path->push_back(pose.world_from_body());
    }
    if (app.count("--frames") == 0) scene.num_frames = static_cast<int>(out.path->size());
  }
  out.scene = std::move(scene);
  return out;
}

int make_drive(const Command& command, const SynthDriveOptions& options, const std::string& folder,
               bool overwrite, bool json) {
  const SynthDriveSummary summary =
      synthesise_drive(options, folder, overwrite, make_progress(command.common));
  if (json) {
    std::cout << nlohmann::json{{"version", kVersion},
                                {"seed", options.scene.seed},
                                {"options", options_json(options)},
                                {"scene", folder},
                                {"name", summary.scene.name},
                                {"frames", options.scene.num_frames},
                                {"cars", summary.scene.cars},
                                {"detections", summary.scene.detections},
                                {"speed", summary.scene.speed},
                                {"length", summary.length},
                                {"standstills", summary.standstills},
                                {"true_height", summary.true_height},
                                {"true_focal_ratio", summary.true_focal_ratio},
                                {"timings_ms", timings_json(summary.scene)}}
                     .dump(2)
              << '\n';
  } else if (!command.common.quiet) {
    std::fprintf(stderr, "%s: %d frames, %.1f m, %d standstills, %d cars, %d detections\n",
                 folder.c_str(), options.scene.num_frames, summary.length, summary.standstills,
                 summary.scene.cars, summary.scene.detections);
  }
  return 0;
}

}  // namespace

void register_synth(App& root) {
  Command* command = add_command(
      root, "synth", "Makes a scene of a road with cars: images, detections, complete truth",
      "  camber synth --profile steep_hill --frames 3 --seed 7 --out scene\n"
      "  camber synth --random 17 --out scene_17\n"
      "  camber synth --corner stem --turn left --wet 0.8 --frames 10 --out corner\n"
      "  camber synth --profile crest --size 960x540 --intrinsics 423.8,423.8,479.5,269.5 --hz 5 "
      "--out scene\n"
      "  camber synth --layout synthia-sf --size 960x540 --out made\n"
      "  camber synth --distortion brown,-0.3,0.1,0,0 --out scene\n"
      "  camber synth --drive --seed 3 --frames 300 --out drive\n"
      "  camber synth --drive --path poses.txt --size 320x96 --out drive");
  struct Arguments {
    Settings settings;
    DriveArguments drive;
    std::string out;
    std::uint64_t number = 0;
    bool overwrite = false, json = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  App& app = *command->app;
  app.add_option("--out", arguments->out, "folder of the scene")->output_folder()->required();
  app.add_flag("--overwrite", arguments->overwrite, "replace a foreign folder that is not empty");
  app.add_flag("--json", arguments->json, "print what was made as JSON");
  app.add_option("--random", arguments->number,
                 "scene of this number of a wide distribution (see "
                 "random_scene.h); options given besides replace what it "
                 "draws, --seed is that of the series")
      ->check(whole_number());
  add_drive(app, &arguments->settings);
  add_camera(app, &arguments->settings);
  add_layout(app, &arguments->settings);
  add_turning(app, &arguments->settings);
  add_surroundings(app, &arguments->settings);
  add_whole_drives(app, &arguments->drive);

  command->run = [command, arguments, &app] {
    SynthOptions options;
    if (command->app->count("--random") > 0) {
      options = random_scene_options(arguments->number, command->common.seed);
    } else {
      options.seed = command->common.seed;
    }
    options.num_threads = command->common.threads;
    options.command = command->common.command_line;
    arguments->settings.apply(&options);
    check_used(app, options);
    check_drive_used(app, arguments->drive.drive);
    if (arguments->drive.drive) {
      return make_drive(*command, drive_options(app, arguments->drive, std::move(options)),
                        arguments->out, arguments->overwrite, arguments->json);
    }
    follow_layout(app, &options);
    const SynthSummary summary = synthesise_scene(options, arguments->out, arguments->overwrite,
                                                  make_progress(command->common));
    if (arguments->json) {
      std::cout << summary_json(options, summary, arguments->out).dump(2) << '\n';
    } else if (!command->common.quiet) {
      std::fprintf(stderr, "%s: %d frames, %d cars, %d detections\n", arguments->out.c_str(),
                   options.num_frames, summary.cars, summary.detections);
    }
    return 0;
  };
}

}  // namespace camber::tools
