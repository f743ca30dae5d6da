#include "run_verb.h"

CAMBER_EXPORT int camber_run(int argc, char** argv) {
  using namespace camber::tools;
  return run_verb(argc, argv,
                  {{"plane", register_plane},
                   {"patches", register_patches},
                   {"ground", register_ground},
                   {"lift", register_lift},
                   {"export", register_export},
                   {"view", register_view},
                   {"info", register_info},
                   {"convert", register_convert},
                   {"filter", register_filter},
                   {"tiles", register_tiles}});
}
