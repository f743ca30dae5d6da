// Points of an OpenDRIVE road as libOpenDRIVE has them.
// odr_points FILE: reads rows "S T" from standard input and writes "X Y Z" of the surface; first a
// row "LENGTH". What the library warns of goes to standard error.
#include <cstdio>

#include "OpenDriveMap.h"

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  const odr::OpenDriveMap map(argv[1], false);
  if (map.get_roads().size() != 1) return 3;
  const odr::Road road = map.get_roads().front();
  std::printf("%.17g %zu\n", road.length, road.get_road_objects().size());
  double s = 0.0, t = 0.0;
  while (std::scanf("%lf %lf", &s, &t) == 2) {
    const odr::Vec3D p = road.get_surface_pt(s, t);
    std::printf("%.17g %.17g %.17g\n", p[0], p[1], p[2]);
  }
  return 0;
}
