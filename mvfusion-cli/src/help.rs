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
about everything. With --data a folder is read: Neu3D, photos with a COLMAP model, NeRF On-the-go, RobustNeRF, D-NeRF, \
HyperNeRF, nerfstudio, Panoptic Sports, MultipleView (docs/data.md); `mvfusion check DIR` tells what is found there.

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
  report.html                    look here first: metrics, curves, pictures with
                                 sliders, on one page that any browser shows;
                                 `mvfusion report DIR` makes it again
  strips/NNNNN.png               ground truth, composed, static, dynamic, mask,
                                 motion intensity
  results.json, per_view.json    the metrics, in full precision; a metric that
                                 is not known is absent
  metrics.jsonl                  a line for every log step, while training runs
  config.toml, run.json          what was done; --config DIR/config.toml does it
                                 again
  checkpoints/final.safetensors  the whole state; `mvfusion eval DIR` prints the
                                 same metrics from it
  point_cloud/iteration_N/       static.ply and dynamic.ply, for other viewers
  renders/test/LAYER/NNNNN.png   every layer of every held-out view
  films/VIEWS/                   what `mvfusion render DIR` makes

Exit codes:
  0  all went well
  1  a failure: data that cannot be read, a folder that cannot be written, a
     training that diverged
  2  a wrong command line: unknown option, preset, key or device, a value of the
     wrong kind";

/// `mvfusion eval --help`.
pub const EVAL: &str = "\
Reads configuration and last checkpoint of a run, renders the held-out views, and prints the table that training ended \
with, and how many frames a second are rendered. Says so when a metric differs from the run's results.json. Writes \
nothing unless --write is given; then metrics, pictures and report.html, or, of another protocol than ours, metrics in \
protocols/NAME.

Metrics of one name are computed in many ways. A protocol is the way of one body of results: mvfusion has every metric; \
degauss, 3dgs and nerfbaselines have those that these report. docs/evaluation.md tells the differences. LPIPS needs weights \
that are not part of this program.";

/// `mvfusion export --help`, above the options.
pub const EXPORT: &str = "\
Reads the last checkpoint of a run and writes its Gaussians for viewers and other programs: each branch as a PLY file \
in the layout of 3DGS, both together as .splat, as the folder of 3DGS, or as a sequence of PLY files that SuperSplat \
plays (drop the files of the folder `frames` onto it). cameras.json is always written.

In PLY files all numbers are those before activation: sizes as logarithms, opacities as logits, quaternions w, x, y, z. A branch's \
file holds them as they were trained, or as they are moved at --time; dynamic.ply keeps the logits of the learned mask \
as extra fields. Where both branches lie in one file (.splat, inria, frames) there is no mask, which no viewer knows: \
a dynamic Gaussian's opacity is multiplied by the share of the foreground in its own mask. The brightness that the mask \
gives to the static branch is left out.";

/// `mvfusion export --help`, below the options.
pub const EXPORT_MORE: &str = "\
Examples:
  mvfusion export runs/quickstart-0 --out gaussians
          static.ply, dynamic.ply (before they are moved), cameras.json
  mvfusion export runs/quickstart-0 --out sequence --frames 60
          the same, and frames/frame0001.ply to frame0060.ply
  mvfusion export runs/quickstart-0 --out viewer --format inria,splat --time 0.5
          both branches together, half way through
  mvfusion train --set init.static_ply=gaussians/static.ply
          trains with a static branch that starts from such a file";

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

/// `mvfusion render --help`, above the options.
pub const RENDER: &str = "\
Renders a trained run from its checkpoint, in any of its layers, as pictures and animations. The scene must still be there: \
its cameras and times are needed.";

/// `mvfusion render --help`, below the options; lines of at most 80 characters, which no terminal breaks.
pub const RENDER_MORE: &str = "\
Views:
  train, test  the views of the scene, at their times
  spiral       a spiral about the middle of the training cameras
  orbit        around what they look at; between the outermost of them, where
               they stand on less than half of the circle
  still        one camera (--camera), while the time runs
  FILE.json    a camera path: what nerfstudio's viewer exports, or a list like
               the cameras.json of 3DGS. `time` (or `render_time`) of an entry
               is its moment, 0 to 1; without, the time runs through once. Poses
               must be in the scene's own coordinates: nerfstudio turns, centres
               and scales the world of its viewer unless it is told not to

Layers:
  composed, static, dynamic       the blended picture and its two branches
  mask                            share of the dynamic branch
  masked_static, masked_dynamic   what each branch adds to the composed picture
  depth                           along the axis, world units; as a picture grey
                                  by its inverse: near is white, nothing black
  alpha                           how much of the background is hidden
  motion                          motion intensity under --motion-weights
  position_variance, rotation_variance, scale_variance
                                  what it is made of; as pictures heat maps,
                                  white is what 2 % of the dynamic Gaussians
                                  exceed

Files, in RUN/films/VIEWS or --out:
  LAYER/NNNNN.png   8 bits
  exr/NNNNN.exr     all layers as 32-bit floats, in channels such as composed.R,
                    depth.Z, mask.Y; values as rendered, not linearised. The
                    first layer of colours is there as R, G, B as well, for
                    viewers that know no layers
  LAYER.gif         at most 640 pixels wide
  video_LAYER.mp4   H.264, by ffmpeg; an odd size loses its last column or row

Examples:
  mvfusion render runs/quickstart-0
  mvfusion render runs/quickstart-0 --views orbit --time 0.5 --layers composed
  mvfusion render runs/quickstart-0 --views still --camera cam00 --format exr
  mvfusion render runs/quickstart-0 --layers motion --motion-weights 1,0,0";

/// `mvfusion report --help`.
pub const REPORT: &str = "\
Makes report.html from what lies in a run's folder: metrics with their protocol, curves of the training, sliders between \
photo and picture, every layer of a few views, heat maps of motion, record and configuration. Needs no device and no \
scene. Whatever is missing is named in its place. The page needs no other file and no network.";

/// `mvfusion sweep --help`, above the options.
pub const SWEEP: &str = "\
Trains every cell of a grid: all of its scenes, with each variant, with each combination of the values of its swept keys, with \
each seed. All cells are resolved and checked before the first one runs. A cell is a run like one of `mvfusion train`, in a \
folder whose name follows from its whole configuration.

Start the same command again after an interruption of any kind: finished cells are skipped, interrupted and failed ones start \
again. A cell that fails is reported and does not stop the rest. At the end the table is printed and written: Markdown, LaTeX, \
CSV and JSON, means and spreads over seeds, beside the paper's numbers where the grid has them, and plots of swept keys.";

/// `mvfusion sweep --help`, below the options.
pub const SWEEP_MORE: &str = "\
Examples:
  mvfusion sweep components-small --jobs 2
          the paper's component ablation on the built-in scenes
  mvfusion sweep neu3d --data-root ~/scenes --dry-run
          the cells of the paper's main table, and how long they will take
  mvfusion sweep grid.toml --launcher slurm --sbatch=--partition=gpu
          a grid of your own as a job array; docs/sweeps.md tells its format
  mvfusion sweep status runs/sweeps/grid
  mvfusion sweep table runs/sweeps/grid
          how far it is; the table of what has finished

The sweep's folder:
  table.md, .tex, .csv, .json   the table
  plots/KEY_METRIC.svg          a swept key against a metric
  cells/ID/                     the runs; ID.log beside each is what it said
  grid.toml, sweep.json         the grid, and its cells with their ids

Exit codes:
  0  all went well
  1  a cell has not finished; data or weights are not there; a folder that cannot
     be written
  2  a wrong command line, or a grid that contradicts itself or names what there
     is not";
