//! The keys of SGCT's configurations, and what is said of those that are left out.
//!
//! From `sgct.schema.json`, its older editions and the documentation, in small letters.

/// Said of windows and of projections.
const SPOUT: &str = "Spout and NDI outputs are left out: channels show on displays";

pub(super) const CLUSTER: &[&str] = &[
    "$schema",
    "version",
    "masteraddress",
    "nodes",
    "node",
    "users",
    "user",
    "scene",
    "settings",
    "capture",
    "trackers",
    "tracker",
    "generator",
    "meta",
    "debuglog",
    "debug",
    "debugmode",
    "firmsync",
    "threadaffinity",
    "setthreadaffinity",
    "externalcontrolport",
];

pub(super) const CLUSTER_LEFT_OUT: &[(&str, &str)] = &[
    ("capture", "capture settings are left out: polyptych shot takes pictures"),
    ("trackers", "trackers are left out: a program sends the head's pose"),
    ("tracker", "trackers are left out: a program sends the head's pose"),
    ("threadaffinity", "thread affinity is left out: the system chooses the cores"),
    ("setthreadaffinity", "thread affinity is left out: the system chooses the cores"),
    ("externalcontrolport", "the external control port is left out: clients use the manager's"),
];

pub(super) const SETTINGS: &[&str] = &[
    "depthbuffertexture",
    "normaltexture",
    "positiontexture",
    "precision",
    "display",
    "osdtext",
    "fxaa",
];

pub(super) const SETTINGS_LEFT_OUT: &[(&str, &str)] = &[
    ("depthbuffertexture", "textures of depth, normals and positions are left out"),
    ("normaltexture", "textures of depth, normals and positions are left out"),
    ("positiontexture", "textures of depth, normals and positions are left out"),
    ("precision", "the precision of buffers is left out: light is drawn in 16-bit floats"),
    ("display", "swap interval and refresh rate are left out: frames follow the displays"),
    ("osdtext", "on-screen texts are left out"),
    ("fxaa", "settings of FXAA are left out"),
];

pub(super) const USER: &[&str] =
    &["name", "eyeseparation", "pos", "matrix", "orientation", "tracking"];

pub(super) const NODE: &[&str] =
    &["address", "ip", "port", "name", "datatransferport", "swaplock", "windows", "window"];

pub(super) const NODE_LEFT_OUT: &[(&str, &str)] = &[
    ("swaplock", "swap locks are left out: the displays of a wall always change together"),
    ("datatransferport", "data transfer ports are left out: servers fetch over one port"),
];

pub(super) const WINDOW: &[&str] = &[
    "id",
    "name",
    "tags",
    "pos",
    "size",
    "res",
    "viewports",
    "viewport",
    "stereo",
    "bufferbitdepth",
    "fullscreen",
    "autoiconify",
    "hidemousecursor",
    "floating",
    "alwaysrender",
    "allwaysrender",
    "forcealwaysrender",
    "hidden",
    "dbuffered",
    "doublebuffered",
    "takescreenshot",
    "alpha",
    "msaa",
    "numberofsamples",
    "fxaa",
    "border",
    "decorated",
    "resizable",
    "draw2d",
    "draw3d",
    "noerror",
    "blitwindowid",
    "blitpreviouswindow",
    "copypreviouswindowtocurrentwindow",
    "mirror",
    "mirrorx",
    "mirrory",
    "monitor",
    "mpcdi",
    "spout",
    "spoutname",
    "ndi",
    "scalablemesh",
    "gamma",
    "contrast",
    "brightness",
];

pub(super) const WINDOW_LEFT_OUT: &[(&str, &str)] = &[
    ("fxaa", "FXAA is left out: samples of [wall] smooths edges"),
    ("border", "window borders are left out"),
    ("decorated", "window borders are left out"),
    ("resizable", "window borders are left out"),
    ("floating", "floating windows are left out: channels fill their monitors"),
    ("autoiconify", "what windows do when they lose the focus is left out"),
    ("hidemousecursor", "the mouse cursor's setting is left out: channels hide it"),
    ("pos", "places of windows are left out: a channel fills its monitor"),
    ("bufferbitdepth", "bit depths of buffers are left out: bits of [channel] is the display's"),
    ("takescreenshot", "screenshot settings are left out: polyptych shot takes pictures"),
    ("noerror", "driver settings are left out"),
    ("dbuffered", "driver settings are left out"),
    ("doublebuffered", "driver settings are left out"),
    ("alwaysrender", "windows that draw while hidden are left out: channels always draw"),
    ("tags", "tags of windows are left out"),
    ("monitor", "monitor numbers are left out: give monitor of [channel] its name"),
    ("spout", SPOUT),
    ("spoutname", SPOUT),
    ("ndi", SPOUT),
];

pub(super) const VIEWPORT: &[&str] = &[
    "user",
    "overlay",
    "mask",
    "blendmask",
    "blacklevelmask",
    "mesh",
    "tracked",
    "eye",
    "pos",
    "size",
    "projection",
    "planarprojection",
    "fisheyeprojection",
    "sphericalmirrorprojection",
    "spoutoutputprojection",
    "spoutflatprojection",
    "cylindricalprojection",
    "equirectangularprojection",
    "cubemapprojection",
    "texturemappedprojection",
    "viewplane",
    "projectionplane",
];

/// Names of projections, in small letters.
pub(super) const PROJECTIONS: &[&str] = &[
    "planarprojection",
    "texturemappedprojection",
    "projectionplane",
    "viewplane",
    "fisheyeprojection",
    "equirectangularprojection",
    "cylindricalprojection",
    "cubemapprojection",
    "spoutoutputprojection",
    "spoutflatprojection",
    "sphericalmirrorprojection",
];

/// The keys of all projections; those of one are checked together.
pub(super) const PROJECTION: &[&str] = &[
    "type",
    "fov",
    "distance",
    "orientation",
    "rigorientation",
    "offset",
    "lowerleft",
    "upperleft",
    "upperright",
    "pos",
    "quality",
    "interpolation",
    "diameter",
    "tilt",
    "crop",
    "keepaspectratio",
    "background",
    "geometry",
    "rotation",
    "heightoffset",
    "radius",
    "mapping",
    "mappingspoutname",
    "spoutname",
    "drawmain",
    "channels",
    "spout",
    "ndi",
    "width",
    "height",
    "planarprojection",
];

pub(super) const PROJECTION_LEFT_OUT: &[(&str, &str)] = &[
    ("quality", "the resolution of cube maps is left out: as many pixels are drawn as are shown"),
    ("interpolation", "the interpolation of cube maps is left out: it is bicubic"),
    ("background", "background colours are left out: what no lens lights is black"),
    ("mappingspoutname", SPOUT),
    ("spoutname", SPOUT),
    ("spout", SPOUT),
    ("ndi", SPOUT),
    ("drawmain", SPOUT),
];
