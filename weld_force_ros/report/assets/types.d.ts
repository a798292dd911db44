// What the report and the campaign's summary put into their pages for the scripts, for the type checker.

/** What concerns the whole page. */
interface PageFacts {
  live: boolean;
  title: string;
  newest: number | null;
  /** What marks each decision, the worst first. */
  signs: Record<string, string>;
  /** Sections of the catalogue. */
  words: Record<string, Record<string, string>>;
}

/** A row of the table as it is filtered, sorted and saved: what is not known is absent. */
interface FlatRow {
  weld: string;
  line?: string;
  rail?: string;
  chainage_m?: number;
  measured_on?: string;
  decision: string;
  geometry?: string;
  force?: string;
  vehicle?: string;
  worst_criterion?: string;
  times_limit?: number;
  peak_force_n?: number;
  forces_within_limits_up_to_kmh?: number;
  computed_up_to_kmh?: number;
  what_to_do: string;
}

/** A row that a live page's server sends. */
interface LiveRow {
  n: number;
  html: string;
  supersedes?: number[];
}
