//! The long texts of `--help`.

/// `mvfusion --help`.
pub const PROGRAM: &str = "\
Gaussian splatting of dynamic scenes. The model has a static and a dynamic cloud of Gaussians, and a deformation \
network moves the dynamic one. A learned mask blends the two renders. Motion statistics and attention over \
neighbouring frames refine the dynamic Gaussians.

Start with `mvfusion train`. It needs no data and takes a few minutes on a CPU.";

/// `mvfusion train --help`, above the options.
pub const TRAIN: &str = "\
Train MVFusion-GS on a scene, evaluate it on the held-out views, and write everything to one folder.

Without --data, the program uses a small built-in scene: a room with moving objects and complete ground truth. With \
--data, it reads a folder: Neu3D, photos with a COLMAP model, NeRF On-the-go, RobustNeRF, D-NeRF, HyperNeRF, \
nerfstudio, Panoptic Sports or MultipleView (docs/data.md). `mvfusion check DIR` reports what a folder contains.

Training has three stages: base geometry (nothing moves), base deformation (the network learns to move the dynamic \
Gaussians) and motion-aware refinement. The progress line shows the stage, the step, the steps per second, the \
remaining time, the loss, the PSNR and the numbers of static and dynamic Gaussians. A table of metrics follows at the \
end.

The program checks everything before it creates the run folder. A run that fails before its first step removes its \
folder. A checkpoint is written after the first step and then every ten minutes (train.checkpoint_minutes). Ctrl-C and \
SIGTERM save one and print the command that continues the run (--resume RUN); a second signal ends the program at once.";

/// `mvfusion train --help`, below the options. Lines of at most 80 characters are not wrapped by any terminal.
pub const TRAIN_MORE: &str = "\
Examples:
  mvfusion train
          the built-in video
  mvfusion train --set scene.kind=casual
          the built-in photos with passers-by
  mvfusion train --data ~/scenes/flame_steak
          a video, with the preset neu3d at full length
  mvfusion train --data ~/scenes/flame_steak --set train.scale=0.05
          the same video with a twentieth of the steps
  mvfusion train --view
          the built-in video, watched in a browser (feature viewer)
  mvfusion train --set model.deformation=false --out runs/still
          a baseline without deformation
  mvfusion train --config runs/quickstart-0/config.toml --seed 1
          an earlier run with another seed
  mvfusion train --resume runs/quickstart-0
          an interrupted run, from its newest checkpoint
  mvfusion train --resume runs/quickstart-0 --set train.stages.refinement=9000
          a finished run, for more steps
  mvfusion train --init-from runs/quickstart-0 --out runs/tuned
          a new run that begins with the weights of another one

Configuration:
  preset  <-  --config FILE  <-  --set KEY=VALUE  <-  --seed, --data
  Each layer overrides the layers to its left. The value of --set is TOML (0.1,
  true, [1, 2], \"text\"); a value that is not valid TOML is read as a string.
  `mvfusion config` prints all keys with the values that a run would use. An
  unknown key is an error, and the message suggests the most similar key.
  train.scale multiplies all numbers of steps. Paths are relative to the current
  folder.

The run folder:
  report.html                    start here: metrics, curves, and images with
                                 sliders, on one page for any browser;
                                 `mvfusion report DIR` rebuilds it
  strips/NNNNN.png               ground truth, composed, static, dynamic, mask,
                                 motion intensity
  results.json, per_view.json    the metrics in full precision; unknown metrics
                                 are absent
  metrics.jsonl                  one line per log step, written during training
  tensorboard/                   the same for TensorBoard, if asked for:
                                 --set train.tensorboard=true
  config.toml, run.json          the configuration and the record of the run;
                                 --config DIR/config.toml repeats the run, with
                                 --init-from RUN if run.json has init_from
  checkpoints/final.safetensors  the complete training state, from which
                                 `mvfusion eval DIR` computes the same metrics
  checkpoints/step_N.safetensors the newest states before that, from which
                                 `mvfusion train --resume DIR` continues
  point_cloud/iteration_N/       static.ply and dynamic.ply, for other viewers
  renders/test/LAYER/NNNNN.png   every layer of every held-out view
  films/VIEWS/                   the output of `mvfusion render DIR`

Exit codes:
  0  success
  1  failure: unreadable data, a folder that cannot be written to, or a training
     that diverged
  2  wrong command line: an unknown option, preset, key or device, or a value of
     the wrong type
  129, 130, 143
     interrupted by SIGHUP, SIGINT (Ctrl-C) or SIGTERM; the last checkpoint is
     that of the last step, and --resume goes on from it";

/// `mvfusion eval --help`.
pub const EVAL: &str = "\
Evaluate a run again from its last checkpoint. The command renders the held-out views and prints the same table as \
training, together with the frame rate. It reports all metrics that differ from the run's results.json. It writes \
nothing unless --write is given. With --write, it writes metrics, images and report.html. Metrics of another protocol \
than ours go to protocols/NAME, without images.

If the parameters in the checkpoint are not those that results.json describes, the exit code is 1, and --write writes \
nothing. --write also refuses if config.toml has changed since, or if the held-out photos are others.

Different projects compute metrics of the same name in different ways. A protocol fixes the definitions that one group \
of results uses. The protocol mvfusion has every metric; degauss, 3dgs and nerfbaselines have the metrics that these \
projects report. docs/evaluation.md explains the differences. LPIPS needs network weights that do not ship with this \
program.";

/// `mvfusion export --help`, above the options.
pub const EXPORT: &str = "\
Export the Gaussians of a run's last checkpoint for viewers and other programs. The formats are: one PLY file per \
branch in the layout of 3DGS; both branches together as .splat, as glTF (.glb) or in the folder layout of 3DGS; both \
in motion as .4dgs; each branch as NumPy arrays (.npz); and a sequence of PLY files that SuperSplat plays (drop the \
files of the folder `frames` onto it). \
cameras.json is always written.

PLY files store the parameters before activation: scales as logarithms, opacities as logits, quaternions as w, x, y, \
z. The file of a branch contains the Gaussians as trained, or as deformed at --time. dynamic.ply also stores the \
logits of the learned mask, as extra fields. No viewer supports this mask, so files with both branches do not contain \
it. Instead, opacities and colours of the dynamic Gaussians are changed so that they hide as much of the static branch \
as the mask does. The PSNR of these files against `mvfusion render` is printed.";

/// `mvfusion export --help`, below the options.
pub const EXPORT_MORE: &str = "\
Examples:
  mvfusion export runs/quickstart-0 --out gaussians
          static.ply, dynamic.ply (before deformation), cameras.json
  mvfusion export runs/quickstart-0 --out sequence --frames 60 --shared-static
          the same, and frames/frame0001.ply to frame0060.ply without the static
          Gaussians, which static.ply has
  mvfusion export runs/quickstart-0 --out viewer --format glb,splat --time 0.5
          both branches together, halfway through the time range
  mvfusion export runs/quickstart-0 --out film --format 4dgs
          the whole scene in motion, in one file
  mvfusion export runs/quickstart-0 --out arrays --format npz --frames 24
          each branch as NumPy arrays (np.load), and the moving one at 24 times
  mvfusion export runs/quickstart-0 --out part --crop-centre 0,0.5,0 --crop-size 2,1,2
          the Gaussians in a box
  mvfusion train --set init.static_ply=gaussians/static.ply
          training with a static branch that starts from such a file";

/// `mvfusion check --help`.
pub const CHECK: &str = "\
Inspect a scene as `train` would read it, and decode every image. The output lists the format, cameras, frames, times, \
split, sizes, points, the memory and the time that training needs, and every problem with its remedy. The command also \
draws the points over several photos, so that wrong pose conventions are easy to spot.

The time is predicted for this machine from a few steps of each stage, which take some seconds.

The exit code is 0 if there is no error. A warning of too little memory does not change it, although `train` then \
refuses to start.";

/// `mvfusion lpips-weights --help`, above the options.
pub const LPIPS: &str = "\
Make the files that LPIPS needs out of those in which its weights are published: torchvision's AlexNet and VGG-16 \
(.pth), and the linear layers in the wheel of the package lpips. Nothing in these files is run, and nothing is \
downloaded. Names, shapes and numbers are checked before anything is written. A network whose parts are not all there \
is left out, and the output says where to get them.

`train`, `eval` and `sweep` look for weights in this order: --lpips-weights, the key eval.lpips_weights (not in a \
grid), the environment variable MVFUSION_LPIPS, the default folder. Each of the first three may be `none`, which leaves \
LPIPS out. The default folder is mvfusion/lpips in the user's data folder: $XDG_DATA_HOME or ~/.local/share on Linux, \
~/Library/Application Support on macOS, %APPDATA% on Windows.";

/// `mvfusion lpips-weights --help`, below the options. Lines of at most 80 characters are not wrapped by any terminal.
pub const LPIPS_MORE: &str = "\
Examples:
  pip download --no-deps lpips
  mvfusion lpips-weights --from ~/.cache/torch/hub/checkpoints lpips-0.1.4-*.whl
          what torchvision has downloaded, and the wheel of lpips
  mvfusion lpips-weights --from alexnet-owt-7be5be79.pth lpips-0.1.4-*.whl
          AlexNet alone
  mvfusion lpips-weights --from site-packages/lpips vgg16-397923af.pth --out w
          the installed package lpips instead of its wheel, and another folder";

/// `mvfusion prepare --help`, above the options.
pub const PREPARE: &str = "\
Make a scene that `train` reads from footage without poses: a folder of photos, the video of one moving camera, or a \
folder with a video for each of several still cameras. The program COLMAP (3.8 or newer), which must be installed, \
finds the poses. `mvfusion check` runs at the end.

Of a moving camera's video, the sharpest frame of each window is taken (--fps). Of still cameras, COLMAP sees the first \
frames, without what moves. Their videos are taken as synchronous unless --offset gives or --sync sound measures when \
each one began; every offset is printed.

The scene folder appears only when all of it is there. It also holds a record of what was done (prepare.json) and the \
log of COLMAP (colmap.log); after a failure, the log lies beside it. Ctrl-C and SIGTERM end COLMAP and leave nothing. \
Footage whose poses are known needs no COLMAP: docs/data.md lists the layouts.";

/// `mvfusion prepare --help`, below the options.
pub const PREPARE_MORE: &str = "\
Examples:
  mvfusion prepare photos/ --out scenes/garden
          photos of one place by one camera
  mvfusion prepare photos/ --masks people/ --out scenes/garden
          the same, without the passers-by that are white in the masks
  mvfusion prepare walk.mp4 --fps 3 --out scenes/walk
          three frames a second of a video by a moving camera
  mvfusion prepare rig/ --sync sound --out scenes/stage
          a video for each still camera, synchronised by their sound
  mvfusion prepare rig/ --offset left=0.48 --offset right=-0.2 --out scenes/stage
          the same, with offsets that are known for left.mp4 and right.mp4";

/// `mvfusion synth --help`.
pub const SYNTH: &str = "\
Write a built-in scene to disk in a common dataset layout: a video (neu3d, panoptic, nerfstudio, multipleview, dnerf, \
hypernerf) or photos with passers-by (colmap, onthego, onthego-colmap, robustnerf). The ground truth is written next \
to it: masks of moving objects, the background and depths. Use it to test programs, and as an example of each layout.";

/// `mvfusion config --help`.
pub const CONFIG: &str = "\
Merge preset, --config, --set, --seed and --data as `train` would, and print the result as TOML, every key with its \
value. The output is a valid file for --config.

--template adds all that is known of each key as comments: what it does, what it accepts, its default and the source of \
that. --explain KEY prints the same of one key or table, what each preset makes of it, and whether a resumed run may \
change it. --schema prints a JSON schema, with which an editor completes and checks configuration files \
(docs/configuration.md).";

/// `mvfusion completions --help`.
pub const COMPLETIONS: &str = "\
Print the script with which a shell completes commands, options, presets and configuration keys.

  bash        mvfusion completions bash > ~/.local/share/bash-completion/completions/mvfusion
  zsh         mvfusion completions zsh > ~/.zfunc/_mvfusion, with ~/.zfunc in $fpath
  fish        mvfusion completions fish > ~/.config/fish/completions/mvfusion.fish
  powershell  mvfusion completions powershell >> $PROFILE
  elvish      mvfusion completions elvish >> ~/.config/elvish/rc.elv";

/// `mvfusion man --help`.
pub const MAN: &str = "\
Write manual pages from the same text as --help: mvfusion.1 and one file for each command, such as mvfusion-train.1. \
`man -l DIR/mvfusion.1` shows one; in ~/.local/share/man/man1, `man mvfusion-train` finds them.";

/// `mvfusion render --help`, above the options.
pub const RENDER: &str = "\
Render a trained run from its checkpoint, in any of its layers, as images and animations. The scene must still be \
available, because rendering needs its cameras and times.";

/// `mvfusion render --help`, below the options. Lines of at most 80 characters are not wrapped by any terminal.
pub const RENDER_MORE: &str = "\
Views:
  train, test  the views of the scene, at their times
  spiral       a spiral around the centre of the training cameras
  orbit        an orbit around the point that the training cameras look at; only
               an arc between the outermost cameras if they cover less than half
               of the circle
  still        one fixed camera (--camera) while time runs
  FILE.json    a camera path: an export of nerfstudio's viewer, or a list like
               the cameras.json of 3DGS. `time` (or `render_time`) of an entry
               is its time, 0 to 1; without it, time runs through once. Poses
               must be in the scene's own coordinates: by default, nerfstudio
               rotates, centres and scales the world of its viewer

Layers:
  composed, static, dynamic       the blended render and its two branches
  mask                            share of the dynamic branch
  masked_static, masked_dynamic   contribution of each branch to the composed
                                  render
  depth                           depth along the optical axis in world units;
                                  images show inverse depth in grey: near is
                                  white, empty space is black
  alpha                           share of the background that is hidden
  motion                          motion intensity under --motion-weights
  position_variance, rotation_variance, scale_variance
                                  components of the motion intensity; images are
                                  heat maps whose brightest colour is the value
                                  that 2 % of the dynamic Gaussians exceed

Files, in RUN/films/VIEWS or --out:
  LAYER/NNNNN.png   8-bit images
  exr/NNNNN.exr     all layers as 32-bit floats, in channels such as composed.R,
                    depth.Z, mask.Y. Colours are those of the images (sRGB),
                    not linear light, so that masked layers add up to
                    composed; viewers that expect linear light show them too
                    bright. The first colour layer is also stored as R, G, B,
                    for viewers without support for layers
  LAYER.gif         at most 640 pixels wide
  video_LAYER.mp4   H.264, encoded by ffmpeg; an odd width or height loses its
                    last column or row
  films.json        the names of all these, by which --force knows them

Examples:
  mvfusion render runs/quickstart-0
  mvfusion render runs/quickstart-0 --views orbit --time 0.5 --layers composed
  mvfusion render runs/quickstart-0 --views still --camera cam00 --format exr
  mvfusion render runs/quickstart-0 --layers motion --motion-weights 1,0,0";

/// `mvfusion view --help`, above the options.
#[cfg(feature = "viewer")]
pub const VIEW: &str = "\
Serve a page that shows a trained run, and print its address. The page renders on this machine, on the run's device, so \
it also works over ssh; it needs no network. Ctrl-C ends the server.

Orbit, pan, zoom and fly; play the time; compare with the photos of the training and held-out cameras; look at the \
branches, the mask, the depth and the motion. The address in the browser holds the view, so that it can be shared. \
Camera paths made there are files for `mvfusion render --views FILE.json`. docs/viewer.md explains the page.";

/// `mvfusion view --help`, below the options.
#[cfg(feature = "viewer")]
pub const VIEW_MORE: &str = "\
Examples:
  mvfusion view runs/quickstart-0
          http://127.0.0.1:8420/, for this machine alone
  mvfusion view runs/quickstart-0 --port 0
          at any free port
  mvfusion view runs/quickstart-0 --host 0.0.0.0
          for other machines, which need the token in the printed address";

/// `mvfusion restore --help`.
pub const RESTORE: &str = "\
Bring back the run that `mvfusion train --force` moved aside. It waits in the subfolder .replaced until the run that \
replaces it is finished. The unfinished run is removed; if it has a checkpoint, only with --force.";

/// `mvfusion report --help`.
pub const REPORT: &str = "\
Rebuild report.html from the files of a run folder: metrics with their protocol, training curves, the held-out views \
over time, sliders between ground truth and render, every layer of several views, motion heat maps, the cameras, the \
record and the configuration. The command \
needs neither a device nor the scene. The page names everything that is missing. It needs no other file and no \
network.";

/// `mvfusion sweep --help`, above the options.
pub const SWEEP: &str = "\
Train every cell of a grid: each combination of a scene, a variant, values of the swept keys and a seed. All cells are \
resolved and checked before the first one runs. A cell is a run like those of `mvfusion train`. The name of its folder \
is derived from its complete configuration.

After an interruption of any kind, start the same command again. It skips finished cells and restarts interrupted and \
failed ones. A cell that fails is reported and does not stop the others. At the end, the table is printed and written \
as Markdown, LaTeX, CSV and JSON. It shows means and standard deviations over seeds, next to the paper's values where \
the grid has them. Swept keys are also plotted.";

/// `mvfusion sweep --help`, below the options.
pub const SWEEP_MORE: &str = "\
Examples:
  mvfusion sweep components-small
          the paper's component ablation on the built-in scenes
  mvfusion sweep neu3d --data-root ~/scenes --dry-run
          the cells of the paper's main table, and a time estimate
  mvfusion sweep grid.toml --launcher slurm --sbatch=--partition=gpu
          your own grid as a job array; docs/sweeps.md describes the format
  mvfusion sweep status runs/sweeps/grid
  mvfusion sweep table runs/sweeps/grid
          the state of each cell; the table of the finished cells

The sweep folder:
  table.md, .tex, .csv, .json   the table
  plots/KEY_METRIC.svg          a metric against a swept key
  cells/ID/                     the runs; ID.log next to each is its output
  grid.toml, sweep.json         the grid, and its cells with their ids

Exit codes:
  0  success
  1  failure: an unfinished cell, missing data or weights, or a folder that
     cannot be written to
  2  wrong command line, or a grid that contradicts itself or names something
     that does not exist";
