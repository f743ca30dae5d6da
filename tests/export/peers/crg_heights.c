/* Heights of an OpenCRG file as ASAM's C reader gives them.
   crg_heights FILE [apply]: reads rows "uv U V" or "xy X Y" from standard input and writes a height
   each, or "none" where the reader refuses. "apply" applies the modifiers, those of the
   file or the reader's own. */
#include <stdio.h>
#include <string.h>

#include "crgBaseLib.h"

int main(int argc, char** argv) {
  char kind[8];
  double a, b, z;
  int data, point;
  crgMsgSetLevel(dCrgMsgLevelNone);
  if (argc < 2 || (data = crgLoaderReadFile(argv[1])) <= 0) return 2;
  /* Not behind crgCheck(): that also sets the reference point to the right edge where none is
     given, and so moves the road aside. */
  if (argc > 2 && strcmp(argv[2], "apply") == 0)
    crgDataSetModifiersApply(data);
  else if (!crgCheck(data))
    return 3;
  point = crgContactPointCreate(data);
  if (point < 0) return 4;
  while (scanf("%7s %lf %lf", kind, &a, &b) == 3) {
    const int good = kind[0] == 'u' ? crgEvaluv2z(point, a, b, &z) : crgEvalxy2z(point, a, b, &z);
    if (good)
      printf("%.17g\n", z);
    else
      printf("none\n");
  }
  return 0;
}
