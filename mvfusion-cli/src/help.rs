//! The long texts of `--help`.

/// `mvfusion --help`.
pub const PROGRAM: &str = "\
Gaussian splatting of dynamic scenes. Two clouds of Gaussians, one static and one that a deformation network moves, \
are blended by a learned mask; motion statistics and attention over neighbouring frames refine the moving one.

Start with `mvfusion train`: it needs no files and takes a few minutes on a CPU.";

/// `mvfusion train --help`, above the options.
pub const TRAIN: &str = "\
Trains MVFusion-GS on a scene, scores it on the held-out views and writes everything into one folder.

Without --data a small scene that ships inside the program is made: a room in which things move, with the truth known \
about everything. With --data a folder is read. Two layouts are understood: Neu3D (cam00/images/*, cam01/images/*, \u{2026}, \
poses_bounds.npy, points3D.ply; the first camera is held out), and photos with a COLMAP model (images/*, sparse/0/*; \
names with clutter train, names with extra are held out, or else every 8th).

Training has three stages: base geometry (nothing moves), base deformation (the network learns to move the dynamic \
Gaussians), motion-aware refinement. A line of progress tells stage, step, steps a second, loss, PSNR, the numbers of \
static and dynamic Gaussians and the time left. At the end there is a table.

Everything is checked before the folder is made; a run that fails before its first checkpoint takes its folder with it.";

/// `mvfusion train --help`, below the options; lines of at most 80 characters, which no terminal breaks.
pub const TRAIN_MORE: &str = "\
Examples:
  mvfusion train
          the built-in video
  mvfusion train --set scene.kind=casual
          the built-in photos with passers-by
  mvfusion train --data ~/scenes/flame_steak
          a video, with the preset neu3d at full length
  mvfusion train --data ~/scenes/flame_steak --set train.scale=0.05
          the same, twenty times shorter
  mvfusion train --set model.deformation=false --out runs/still
          for comparison: nothing may move
  mvfusion train --config runs/quickstart-0/config.toml --seed 1
          an earlier run with another seed

Configuration:
  preset  <-  --config FILE  <-  --set KEY=VALUE  <-  --seed, --data
  Each layer overrides what stands to the left of it. A value given with --set
  is TOML (0.1, true, [1, 2], \"text\"); what is no TOML is taken as text.
  `mvfusion config` prints all keys with the values they would have. A key that
  does not exist is an error that names the nearest one. train.scale multiplies
  every number of steps at once. Paths are relative to the folder in which the
  program is started.

The run's folder:
  strips/NNNNN.png               look here first: ground truth, composed, static,
                                 dynamic, mask, motion intensity
  results.json, per_view.json    the figures, in full precision; a figure that is
                                 not known is absent
  metrics.jsonl                  a line for every log step, while training runs
  config.toml, run.json          what was done; --config DIR/config.toml does it
                                 again
  checkpoints/final.safetensors  the whole state; `mvfusion eval DIR` prints the
                                 same figures from it
  point_cloud/iteration_N/       static.ply and dynamic.ply, for other viewers
  renders/test/LAYER/NNNNN.png   every layer of every held-out view

Exit codes:
  0  all went well
  1  a failure: data that cannot be read, a folder that cannot be written, a
     training that diverged
  2  a wrong command line: unknown option, preset, key or device, a value of the
     wrong kind";

/// `mvfusion eval --help`.
pub const EVAL: &str = "\
Reads configuration and last checkpoint of a run, renders the held-out views, and prints the table that training ended \
with. Says so when a figure differs from the run's results.json. Writes nothing unless --write is given.";

/// `mvfusion check --help`.
pub const CHECK: &str = "\
Reads a scene as `train` would, decodes every picture, and tells what was found: format, cameras, frames, times, split, \
sizes, points, the memory that training will need, and every problem with what to do about it. Draws the points over a \
few photos, so that poses of another convention are seen at once.

The exit code is 0 only if training could start.";

/// `mvfusion synth --help`.
pub const SYNTH: &str = "\
Writes a built-in scene as files, in a layout that the field uses: a video (neu3d, panoptic, nerfstudio, multipleview, \
dnerf, hypernerf) or photos with passers-by (colmap, onthego, onthego-colmap, robustnerf). What is known of the scene lies \
beside it: masks of what moves, the background, depths. For trying programs, and examples of what each layout looks like.";

/// `mvfusion config --help`.
pub const CONFIG: &str = "\
Merges preset, --config, --set, --seed and --data as `train` would and prints the result as TOML, every key with its \
value. The output is a file for --config.";
