// What report/table_row.py, report/weld_detail.py and campaign/summary.py put into a page as JSON, for the type checker.
// Whatever an older recording may lack is optional.

/** A row of the front table. */
interface Row {
  n: number;
  supersedes?: number[];
  weld: string;
  decision: string;
  advice: string;
  worst?: {name: string; base_m?: number; ratio: number | null; passed: boolean; verified: boolean};
  peak_n?: number;
  judged_kmh?: number;
  permitted_kmh?: number;
  rail?: string;
  chainage_m?: number;
  unverified?: number;
  criteria?: number;
  geometry?: RowAnswer;
  force?: RowAnswer;
  basis?: Basis;
  /** What is searched in; made when first needed. */
  text?: string;
}

/** An answer as the front table shows it. */
interface RowAnswer {
  decision: string;
  exceeding?: number;
}

/** What a verdict with two answers rests on. */
interface Basis {
  /** Name and title of each. */
  rule_books: string[];
  risk?: number;
  track?: string;
  /** In which direction trains run. */
  running?: string;
  vehicle?: string;
  static_n: number;
  unsprung_kg?: number;
  measured_on?: string;
  line_kmh?: number;
  /** Profile or map are not at hand, so that nobody can tell what was stated. */
  unknown?: boolean;
}

/** What concerns the whole page. */
interface PageFacts {
  live: boolean;
  title: string;
  newest: number | null;
}

interface Criterion {
  name: string;
  value: number;
  limit: number;
  unit: string;
  passed: boolean;
  source: string;
  verified: boolean;
  ratio: number | null;
  decides?: boolean;
  reject_limit?: number;
  margin?: number;
  applies?: string;
  speed_kmh?: number;
  position_m?: number;
  x_m?: number;
  low?: number;
  high?: number;
  exceeding?: number;
  exceeding_reject?: number;
  driver?: string;
  driver_share?: number;
  base_m?: number;
  rule_book?: string;
  source_kind?: string;
}

/** The answer to one of the two questions about a weld. */
interface Answer {
  decision: string;
  reason: string;
  rule_books?: string[];
  margin?: number;
  exceeding?: number;
  source: string;
  verified: boolean;
  /** The criterion nearest to its limit. */
  nearest?: Criterion;
  /** What stands in the way of accepting. */
  doubts: string[];
  /** How to choose a rule book where none was applied. */
  to_choose?: string;
}

interface PositionOutcome {
  position_m: number;
  decision: string;
}

interface Verdict {
  weld_id: string;
  decision: string;
  reason: string;
  /** What to measure where the verdict is undecided, else empty. */
  measure: string;
  criteria: Criterion[];
  unjudged?: string[];
  peak_force_n: number;
  static_load_n: number;
  worst_speed_kmh: number;
  worst_position_m: number;
  worst_x_m: number;
  judged_speed_kmh: number;
  permitted_speed_kmh?: number;
  advice_step_kmh?: number;
  advice?: string[];
  avoid?: {from_kmh: number; to_kmh: number}[];
  restrictions?: {speed_kmh: number; peak_force_n: number; change: number; within_limits: boolean}[];
  by_position?: PositionOutcome[];
  curve_class?: string;
  worst_running?: string;
  samples?: number;
  geometry?: Answer;
  force?: Answer;
  accepted_risk?: number;
  measure_next?: string;
}

interface ForceMap {
  speeds_kmh: number[];
  positions_m: number[];
  span_m: number;
  /** Row-major: speed, position. */
  peak_n: number[];
  /** Likewise, "1" at local minima over speed, where a lower speed reached more. */
  hollow: string;
  static_load_n: number;
  model_error?: number;
  line_speed_kmh?: number;
  weld_position_m?: number;
  /** In which direction trains run, in words. */
  running?: string;
  measures?: {kind: string; dip_m: number; protrusion_m: number; gradient_rad: number};
}

interface SpeedLimit {
  limit: number;
  reject_limit?: number;
  verified: boolean;
  decides?: boolean;
  above_kmh?: number;
  from_kmh?: number;
  below_kmh?: number;
  to_kmh?: number;
}

/** A criterion over speed, at its worst position. */
interface Series {
  name: string;
  unit: string;
  values: number[];
  limits: SpeedLimit[];
  /** A character a speed: "1" if all speeds up to it are within limits. */
  within: string;
}

interface Curves {
  speeds_kmh: number[];
  series: Series[];
  best: {speeds_kmh: number[]; peak_n: number[]} | null;
  /** Differences of forces below that share of their dynamic part are not told apart: fit error and model uncertainty. */
  error_share?: number;
  static_n?: number;
}

interface ForceHistory {
  speed_kmh: number;
  position_m: number;
  x_m: number[];
  force_n: number[];
  irregularity_m: number[];
}

interface Profile {
  x_m: number[];
  z_m: number[];
  low_m?: number[];
  high_m?: number[];
  noise_m?: number;
  measured_x_m?: number[];
  measured_z_m?: number[];
  wrong_x_m?: number[];
  wrong_z_m?: number[];
  wheel_x_m?: number[];
  wheel_m?: number[];
  /** How deep the wheel reaches, at `x_m`; above the rail where it bridges. */
  underside_m?: number[];
  bridged_m?: number;
  /** The quality index along the weld: inclination over 25 mm over the norm. */
  index?: number[];
  index_from_m?: number;
  index_step_m?: number;
  norm_rad?: number;
  /** The line's speed, or the highest that was computed, that the norm is of. */
  norm_kmh?: number;
}

interface Grinding {
  reached: boolean;
  reason: string;
  x_m: number[];
  ground_m: number[];
  most_removed_m: number;
  /** In the order of x, from the weld's centre. */
  spots: {from_m: number; to_m: number; depth_m: number; deepest_m: number; side: string}[];
  /** What lies beyond the ends, that of falling and that of rising x. */
  ends: [falling: string, rising: string];
  hand_margin_m?: number;
  peak_by_hand_n?: number;
  band_limit_m: number;
  stone_radius_m: number;
  decision_before: string;
  decision_after: string;
  after: Criterion[];
  speeds_kmh: number[];
  peak_after_n: number[];
  reference_checked: number;
  reference_within: number;
  reference_peak_n?: number;
}

type Provenance = [name: string, value: string][];

/** All that is shown of a weld that was judged. */
interface WeldDetail {
  rejection?: undefined;
  verdict: Verdict;
  basis?: Basis;
  map?: ForceMap;
  curves?: Curves;
  history?: ForceHistory;
  profile?: Profile;
  grinding?: Grinding;
  /** What is known of the sleepers beside the weld, a sentence each. */
  support?: string[];
  provenance: Provenance;
}

/** All that is shown of an input that could not be used. */
interface RejectionDetail {
  rejection: {source: string; reason: string; remedy: string; raw_text: string; truncated: boolean};
  provenance: Provenance;
}

type Detail = WeldDetail | RejectionDetail;

/** Where rows and details come from. */
interface Source {
  start(onRows: (rows: Row[]) => void, onState: (state: string) => void): void;
  detail(n: number): Promise<Detail>;
}

/** A force map as cells between edges, in the units of the chart. */
interface Grid {
  speeds: number[];
  positions: number[];
  peaks: number[][];
  hollow: boolean[][];
  /** Edges in cm. */
  x: number[];
  /** Edges in km/h. */
  y: number[];
}

type Decisions = {[decision: string]: number};

interface CampaignGroup {
  name: string;
  n: number;
  decisions: Decisions;
  median_n: number;
  high_n: number;
  most_n: number;
}

interface CampaignLine {
  line: string;
  first_m: number;
  stretch_m: number;
  speeds_kmh: number[];
  /** (speed, stretch), null where no weld is. */
  peaks_kn: (number | null)[][];
}

interface CampaignFacts {
  title: string;
  welds: number;
  unverified: number;
  limits: number;
  decisions: {decision: string; n: number}[];
  bin_n: number;
  forces: {from_n: number; decision: string; n: number}[];
  groups: {by: string; rows: CampaignGroup[]}[];
  lines: CampaignLine[];
  rejections: {reason: string; n: number; example?: string}[];
  rejected: number;
}

interface CampaignRow {
  weld_id: string;
  line: string;
  section: string;
  vehicle: string;
  rail?: string;
  chainage_m?: number;
  decision: string;
  peak_force_n: number;
  worst_speed_kmh: number;
  worst_criterion: string;
  worst_ratio?: number;
  permitted_speed_kmh?: number;
}

/** What becomes a child of an element; what says nothing is left out. */
type Child = Node | string | false | null | undefined;

/** The part of Plotly that the pages use. */
interface PlotlyCell {
  data: {type: string};
  pointNumber: [number, number];
}

interface PlotlyElement extends HTMLElement {
  on(event: string, listener: (event: {points: PlotlyCell[]}) => void): void;
}

interface PlotlyLibrary {
  newPlot(holder: HTMLElement, traces: object[], layout: object, config: object): Promise<PlotlyElement>;
  relayout(holder: HTMLElement, changes: object): Promise<unknown>;
  purge(holder: Element): void;
  Plots: {resize(holder: Element): Promise<unknown>};
}

interface Window {
  Plotly?: PlotlyLibrary;
}

interface Uint8ArrayConstructor {
  /** Newer browsers only. */
  fromBase64?(text: string): Uint8Array<ArrayBuffer>;
}
