#include "run_verb.h"

CAMBER_EXPORT int camber_run(int argc, char** argv) {
  using namespace camber::tools;
  return run_verb(argc, argv,
                  {{"reconstruct", register_reconstruct},
                   {"drive", register_drive},
                   {"calibrate", register_calibrate},
                   {"triangulate", register_triangulate},
                   {"vehicles", register_vehicles},
                   {"detect", register_detect},
                   {"profile", register_profile},
                   {"compare", register_compare},
                   {"evaluate", register_evaluate},
                   {"render", register_render},
                   {"import", register_import},
                   {"keypoints", register_keypoints},
                   {"prior", register_prior},
                   {"synth", register_synth}});
}
